/* SPDX-License-Identifier: GPL-3.0-or-later */
#include "billboard/egl.h"

#include "fumarole.h"

#include <dlfcn.h>
#include <stdbool.h>
#include <string.h>

/* POSIX gives functions as data pointers, which ISO C doesn't convert. */
static bool load_function(void *library, const char *name, void *out_function) {
  void *symbol = dlsym(library, name);
  memcpy(out_function, &symbol, sizeof symbol);
  return symbol != NULL;
}

static int32_t load_library(fum_egl *egl, fum_gl_error *error) {
  /* Never closed: drivers keep threads and thread-local data that outlive a context. */
  void *library = dlopen("libEGL.so.1", RTLD_NOW | RTLD_LOCAL);
  if (library == NULL) {
    return fum_gl_error_set(error, FUM_ERROR_DEVICE,
                            "OpenGL can't be reached because libEGL.so.1 is missing (%s); on Debian install libegl1, "
                            "libegl-mesa0 and libgl1-mesa-dri",
                            dlerror());
  }
#define LOAD(type, name)                                                                                               \
  if (!load_function(library, "egl" #name, &egl->name))                                                                \
    return fum_gl_error_set(error, FUM_ERROR_DEVICE, "libEGL.so.1 has no egl" #name "; it is too old or damaged");
  FUM_EGL_FUNCTIONS(LOAD)
#undef LOAD
  return FUM_OK;
}

/* The name must stand in the list as a whole word. */
static bool has_extension(const char *list, const char *name) {
  const size_t length = strlen(name);
  for (const char *at = list; at != NULL && (at = strstr(at, name)) != NULL; at += length) {
    const bool starts = at == list || at[-1] == ' ';
    if (starts && (at[length] == ' ' || at[length] == '\0')) return true;
  }
  return false;
}

static int32_t open_display(fum_egl *egl, EGLDisplay display, const char *platform, fum_gl_error *error) {
  const EGLint attributes[] = {
      EGL_CONTEXT_MAJOR_VERSION,           3,       EGL_CONTEXT_MINOR_VERSION, 3, EGL_CONTEXT_OPENGL_PROFILE_MASK,
      EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT, EGL_NONE};
  EGLint major = 0, minor = 0;
  if (display == EGL_NO_DISPLAY || !egl->Initialize(display, &major, &minor)) {
    return fum_gl_error_set(error, FUM_ERROR_DEVICE,
                            "EGL's %s platform doesn't start (EGL error 0x%04x); on Debian install libegl-mesa0 and "
                            "libgl1-mesa-dri, or the driver of the graphics card",
                            platform, (unsigned)egl->GetError());
  }
  const char *extensions = egl->QueryString(display, EGL_EXTENSIONS);
  if (!has_extension(extensions, "EGL_KHR_surfaceless_context") ||
      !has_extension(extensions, "EGL_KHR_no_config_context") ||
      (major == 1 && minor < 5 && !has_extension(extensions, "EGL_KHR_create_context")) ||
      !egl->BindAPI(EGL_OPENGL_API)) {
    return fum_gl_error_set(error, FUM_ERROR_DEVICE,
                            "EGL's %s platform can't draw without a window (EGL %d.%d); a newer driver is needed",
                            platform, (int)major, (int)minor);
  }
  EGLContext context = egl->CreateContext(display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes);
  if (context == EGL_NO_CONTEXT || !egl->MakeCurrent(display, EGL_NO_SURFACE, EGL_NO_SURFACE, context)) {
    const unsigned code = (unsigned)egl->GetError();
    if (context != EGL_NO_CONTEXT) egl->DestroyContext(display, context);
    return fum_gl_error_set(error, FUM_ERROR_DEVICE,
                            "OpenGL 3.3 isn't available on EGL's %s platform (EGL error 0x%04x); a newer driver is "
                            "needed (Debian: libgl1-mesa-dri, or the driver of the graphics card)",
                            platform, code);
  }
  egl->display = display;
  egl->context = context;
  return FUM_OK;
}

/* Graphics cards first: where two vendors' drivers are installed, Mesa's surfaceless platform answers with its
 * software rasteriser although a card is there. */
static int32_t open_card(fum_egl *egl, const char *extensions, PFNEGLGETPLATFORMDISPLAYEXTPROC get_display,
                         fum_gl_error *error) {
  enum { MOST_DEVICES = 32 };
  EGLDeviceEXT devices[MOST_DEVICES];
  EGLint count = 0;
  PFNEGLQUERYDEVICESEXTPROC query_devices = (PFNEGLQUERYDEVICESEXTPROC)egl->GetProcAddress("eglQueryDevicesEXT");
  PFNEGLQUERYDEVICESTRINGEXTPROC query_string =
      (PFNEGLQUERYDEVICESTRINGEXTPROC)egl->GetProcAddress("eglQueryDeviceStringEXT");
  const bool enumerates =
      has_extension(extensions, "EGL_EXT_device_base") || has_extension(extensions, "EGL_EXT_device_enumeration");
  if (!enumerates || !has_extension(extensions, "EGL_EXT_platform_device") || query_devices == NULL ||
      query_string == NULL || !query_devices(MOST_DEVICES, devices, &count)) {
    return FUM_ERROR_DEVICE;
  }
  int32_t status = FUM_ERROR_DEVICE;
  for (EGLint i = 0; i < count && status != FUM_OK; i++) {
    if (has_extension(query_string(devices[i], EGL_EXTENSIONS), "EGL_MESA_device_software")) continue;
    status = open_display(egl, get_display(EGL_PLATFORM_DEVICE_EXT, devices[i], NULL), "device", error);
  }
  return status;
}

int32_t fum_egl_open(fum_egl *egl, fum_gl_error *error) {
  int32_t status = load_library(egl, error);
  if (status != FUM_OK) return status;
  const char *extensions = egl->QueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
  PFNEGLGETPLATFORMDISPLAYEXTPROC get_display =
      (PFNEGLGETPLATFORMDISPLAYEXTPROC)egl->GetProcAddress("eglGetPlatformDisplayEXT");
  fum_gl_error_set(error, FUM_ERROR_DEVICE,
                   "EGL finds neither a graphics card nor Mesa's software rasteriser; on Debian install libegl-mesa0 "
                   "and libgl1-mesa-dri");
  if (get_display == NULL || !has_extension(extensions, "EGL_EXT_platform_base")) return FUM_ERROR_DEVICE;
  status = open_card(egl, extensions, get_display, error);
  if (status != FUM_OK && has_extension(extensions, "EGL_MESA_platform_surfaceless")) {
    status =
        open_display(egl, get_display(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL), "surfaceless", error);
  }
  return status;
}

void fum_egl_close(fum_egl *egl) {
  egl->MakeCurrent(egl->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
  egl->DestroyContext(egl->display, egl->context);
  egl->ReleaseThread();
}
