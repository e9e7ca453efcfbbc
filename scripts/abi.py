# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes the two mirrors of the public header, so that neither is kept by hand.

blender_addon/fumarole/core/_abi.py   ctypes structures, constants and function signatures
csrc/api/abi.c                        the table of sizes and offsets that the Python side is checked against

    python3 scripts/abi.py            writes both
    python3 scripts/abi.py --check    exits with 1 and says which one is out of date

The header is read by the few forms it uses. Anything else is an error that names its line.
"""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
HEADER = ROOT / "csrc" / "include" / "fumarole.h"
PYTHON_MIRROR = ROOT / "blender_addon" / "fumarole" / "core" / "_abi.py"
C_TABLE = ROOT / "csrc" / "api" / "abi.c"

SCALARS = {
    "char": "ctypes.c_char",
    "int32_t": "ctypes.c_int32",
    "uint32_t": "ctypes.c_uint32",
    "int64_t": "ctypes.c_int64",
    "uint64_t": "ctypes.c_uint64",
    "size_t": "ctypes.c_size_t",
    "float": "ctypes.c_float",
    "double": "ctypes.c_double",
}

IGNORED_DIRECTIVES = re.compile(r"#(ifndef FUMAROLE_H|define FUMAROLE_H|include <\w+\.h>|endif)")
SKIPPED_BLOCKS = (
    '#ifdef __cplusplus extern "C" { #endif',
    "#ifdef __cplusplus } #endif",
    '#if defined(__GNUC__) #define FUM_API __attribute__((visibility("default"))) #else #define FUM_API #endif',
)


class HeaderError(Exception):
    """The header holds something this parser does not understand."""


@dataclass
class Variable:
    """A field of a struct or a parameter: its name and its C type in pieces."""

    name: str
    base: str
    pointers: int
    const: bool
    array: int | None = None


@dataclass
class Function:
    """A prototype, or with `is_pointer` a function pointer type."""

    name: str
    result: Variable
    parameters: list[Variable]
    is_pointer: bool = False


@dataclass
class Struct:
    """A public struct; without fields it is opaque."""

    name: str
    fields: list[Variable] = field(default_factory=list)


@dataclass
class Header:
    """All that a header declares, `declarations` in its order."""

    constants: dict[str, int] = field(default_factory=dict)
    declarations: list[Struct | Function] = field(default_factory=list)

    def structs(self) -> list[Struct]:
        return [item for item in self.declarations if isinstance(item, Struct) and item.fields]


def blank(text: str) -> str:
    """The same number of lines, without a word on them."""
    return re.sub(r"[^\n]", " ", text)


def remove_comments(text: str) -> str:
    return re.sub(r"/\*.*?\*/", lambda match: blank(match.group()), text, flags=re.DOTALL)


def take_directives(text: str, header: Header) -> str:
    """Reads integer #defines into `header` and gives the text without its preprocessor lines."""
    for block in SKIPPED_BLOCKS:
        pattern = r"\s+".join(re.escape(word) for word in block.split())
        text = re.sub(pattern, lambda match: blank(match.group()), text)
    lines = text.split("\n")
    for number, line in enumerate(lines, start=1):
        line = line.strip()
        if not line.startswith("#"):
            continue
        constant = re.fullmatch(r"#define (FUM_\w+) (-?\d+)", line)
        if constant:
            header.constants[constant.group(1)] = int(constant.group(2))
        elif not IGNORED_DIRECTIVES.fullmatch(line):
            raise HeaderError(f"line {number}: directive not understood: {line}")
        lines[number - 1] = ""
    return "\n".join(lines)


def split_declarations(text: str) -> list[tuple[int, str]]:
    """(line number, text) of each declaration; they end at a semicolon outside all braces."""
    declarations = []
    start, depth = 0, 0
    for position, character in enumerate(text):
        depth += (character == "{") - (character == "}")
        if character == ";" and depth == 0:
            lead = len(text[start:position]) - len(text[start:position].lstrip())
            line = text.count("\n", 0, start + lead) + 1
            declarations.append((line, " ".join(text[start:position].split())))
            start = position + 1
    if text[start:].strip():
        raise HeaderError(f"line {text.count(chr(10), 0, start) + 1}: text without an end: {text[start:].strip()[:60]}")
    return declarations


def parse_variable(text: str, known: set[str]) -> Variable:
    match = re.fullmatch(r"(const )?(?:struct )?(\w+) ?((?:\* ?)*)(\w+)?(?:\[(\d+)\])?", text.strip())
    if not match or (match.group(2) not in known and match.group(2) not in SCALARS and match.group(2) != "void"):
        raise HeaderError(f"type not understood: {text.strip()}")
    const, base, stars, name, array = match.groups()
    return Variable(name or "", base, stars.count("*"), bool(const), int(array) if array else None)


def parse_fields(body: str, known: set[str]) -> list[Variable]:
    """Fields of a struct; `double a, b` counts as two."""
    fields = []
    for line in filter(None, (line.strip() for line in body.split(";"))):
        first, *others = line.split(",")
        variable = parse_variable(first, known)
        if others and variable.pointers:
            raise HeaderError(f"several pointers in one declaration: {line}")
        fields.append(variable)
        for other in others:
            match = re.fullmatch(r"(\w+)(?:\[(\d+)\])?", other.strip())
            if not match:
                raise HeaderError(f"field not understood: {line}")
            name, array = match.groups()
            fields.append(Variable(name, variable.base, 0, variable.const, int(array) if array else None))
    if not all(variable.name for variable in fields):
        raise HeaderError(f"a field has no name: {body}")
    return fields


def parse_parameters(text: str, known: set[str]) -> list[Variable]:
    if text.strip() == "void":
        return []
    return [parse_variable(parameter, known) for parameter in text.split(",")]


def parse_enum(body: str, header: Header) -> None:
    for item in filter(None, (item.strip() for item in body.split(","))):
        match = re.fullmatch(r"(FUM_\w+) = (-?\d+|0x[0-9a-fA-F]+)", item)
        if not match:
            raise HeaderError(f"enumerator without a plain number: {item}")
        header.constants[match.group(1)] = int(match.group(2), 0)


def parse_declaration(text: str, header: Header) -> None:
    known = {item.name for item in header.declarations}
    if match := re.fullmatch(r"enum \{(.*)\}", text):
        parse_enum(match.group(1), header)
    elif match := re.fullmatch(r"typedef struct (fum_\w+) \1", text):
        header.declarations.append(Struct(match.group(1)))
    elif match := re.fullmatch(r"typedef struct (fum_\w+) \{(.*)\} \1", text):
        header.declarations.append(Struct(match.group(1), parse_fields(match.group(2), known)))
    elif match := re.fullmatch(r"typedef (\w+) \(\*(fum_\w+)\)\((.*)\)", text):
        result = parse_variable(match.group(1), known)
        parameters = parse_parameters(match.group(3), known)
        header.declarations.append(Function(match.group(2), result, parameters, is_pointer=True))
    elif match := re.fullmatch(r"FUM_API ([\w ]+?(?: \*|\s))(fum_\w+)\((.*)\)", text):
        result = parse_variable(match.group(1), known)
        header.declarations.append(Function(match.group(2), result, parse_parameters(match.group(3), known)))
    else:
        raise HeaderError(f"declaration not understood: {text[:100]}")


def parse_header(text: str) -> Header:
    """All declarations of a header's text; HeaderError with the line of what it does not understand."""
    header = Header()
    for line, declaration in split_declarations(take_directives(remove_comments(text), header)):
        try:
            parse_declaration(declaration, header)
        except HeaderError as error:
            raise HeaderError(f"line {line}: {error}") from None
    return header


def ctypes_type(variable: Variable, functions: set[str]) -> str:
    """The ctypes expression of a field's, a parameter's or a result's type."""
    base, pointers = variable.base, variable.pointers
    if base == "char" and variable.const and pointers:
        text, pointers = "ctypes.c_char_p", pointers - 1
    elif base == "void":
        text, pointers = ("ctypes.c_void_p", pointers - 1) if pointers else ("None", 0)
    else:
        text = SCALARS.get(base, base)
    if base in functions and pointers:
        raise HeaderError(f"pointer to a function type: {variable.name}")
    for _ in range(pointers):
        text = f"ctypes.POINTER({text})"
    return f"{text} * {variable.array}" if variable.array else text


PYTHON_HEAD = '''\
# SPDX-License-Identifier: GPL-3.0-or-later
"""The C interface as ctypes sees it. Written by scripts/abi.py from csrc/include/fumarole.h; do not edit."""

import ctypes

'''

PYTHON_TAIL = '''

def choices(prefix: str) -> dict[str, int]:
    """Constants whose name starts with `prefix`, by the rest of their name: choices("FUM_SOLVER_")["EXACT"]."""
    return {name[len(prefix) :]: value for name, value in globals().items() if name.startswith(prefix)}
'''


def python_struct(struct: Struct, functions: set[str]) -> str:
    if not struct.fields:
        return f'\n\nclass {struct.name}(ctypes.Structure):\n    """Opaque."""\n'
    lines = [f"\n\nclass {struct.name}(ctypes.Structure):", "    _fields_ = ["]
    lines += [f'        ("{item.name}", {ctypes_type(item, functions)}),' for item in struct.fields]
    return "\n".join(lines) + "\n    ]\n"


def python_signature(function: Function, functions: set[str]) -> list[str]:
    return [ctypes_type(item, functions) for item in function.parameters]


def python_mirror(header: Header) -> str:
    """Text of _abi.py."""
    functions = {item.name for item in header.declarations if isinstance(item, Function) and item.is_pointer}
    text = PYTHON_HEAD + "".join(f"{name} = {value}\n" for name, value in header.constants.items())
    prototypes = []
    for item in header.declarations:
        if isinstance(item, Struct):
            text += python_struct(item, functions)
            continue
        result = ctypes_type(item.result, functions)
        parameters = ", ".join(python_signature(item, functions))
        if item.is_pointer:
            text += f"\n\n{item.name} = ctypes.CFUNCTYPE({result}, {parameters})\n"
        else:
            prototypes.append(f'    "{item.name}": ({result}, [{parameters}]),\n')
    text += "\n\nSTRUCTS = (\n" + "".join(f"    {struct.name},\n" for struct in header.structs()) + ")\n"
    text += "\n# name: (result, parameters)\nFUNCTIONS = {\n" + "".join(prototypes) + "}\n"
    return text + PYTHON_TAIL


C_HEAD = """\
/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Sizes and offsets of the public structs, as compiled. Written by scripts/abi.py from fumarole.h; do not edit. */
#include "fumarole.h"

/* clang-format off */
#define STRUCT(type) {#type, "", 0, (uint32_t)sizeof(type)}
#define FIELD(type, field) {#type, #field, (uint32_t)offsetof(type, field), (uint32_t)sizeof(((type *)0)->field)}
/* clang-format on */

static const fum_abi_field abi_fields[] = {
"""

C_TAIL = """\
};

int32_t fum_abi_fields(const fum_abi_field **out_fields) {
  *out_fields = abi_fields;
  return (int32_t)(sizeof abi_fields / sizeof abi_fields[0]);
}
"""


def c_table(header: Header) -> str:
    """Text of abi.c."""
    text = C_HEAD
    for struct in header.structs():
        text += f"    STRUCT({struct.name}),\n"
        text += "".join(f"    FIELD({struct.name}, {item.name}),\n" for item in struct.fields)
    return text + C_TAIL


def main() -> int:
    parser = argparse.ArgumentParser(description="Writes the ctypes mirror and the table of sizes from the header.")
    parser.add_argument("--check", action="store_true", help="write nothing, fail when a file is out of date")
    check = parser.parse_args().check
    try:
        header = parse_header(HEADER.read_text(encoding="utf-8"))
        wanted = {PYTHON_MIRROR: python_mirror(header), C_TABLE: c_table(header)}
    except HeaderError as error:
        print(f"{HEADER.relative_to(ROOT)}, {error}", file=sys.stderr)
        return 1
    stale = [path for path, text in wanted.items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    for path in stale:
        if check:
            print(f"{path.relative_to(ROOT)} is out of date: run python3 scripts/abi.py", file=sys.stderr)
        else:
            path.write_text(wanted[path], encoding="utf-8")
    return 1 if check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
