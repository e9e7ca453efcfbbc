/* SPDX-License-Identifier: GPL-3.0-or-later */
/* Receivers on their way to the batch of slabs at whose turn they are read; a part of sweep_loop.h. They are found
 * shortly before that, as those of a whole patch fill no cache. */

/* A chunk is left for the next when it holds as many. Entries behind them may be read and written. */
enum { CHUNK = 64, CHUNK_ROOM = CHUNK + FUM_LANES + AHEAD };

/* Receivers of a batch: places in cells and slabs; and in the order of the octree. */
typedef struct chunk {
  float columns[CHUNK_ROOM], rows[CHUNK_ROOM], ranges[CHUNK_ROOM];
  uint32_t indices[CHUNK_ROOM];
  int32_t count;
  struct chunk *before; /* of the same batch, or unused like this one; NULL: none is */
} chunk;

typedef struct queue {
  chunk *chunks, *unused;
  chunk **last;          /* [batches] NULL: nothing is read at its turn */
  int64_t used, waiting; /* chunks that ever were; receivers */
} queue;

/* Room for up to `count` receivers; what isn't needed isn't touched. */
static void open_queue(fum_sweep_scratch *scratch, int64_t count, int32_t slab_count, queue *out) {
  const int64_t batches = slab_count / BATCH, chunks = count / CHUNK + batches;
  *out = (queue){.chunks = reserve(scratch, FUM_SWEEP_CHUNKS, chunks * (int64_t)sizeof(chunk)),
                 .last = reserve(scratch, FUM_SWEEP_BATCHES, batches * (int64_t)sizeof(chunk *))};
  if (!scratch->is_out_of_memory) memset(out->last, 0, (size_t)batches * sizeof(chunk *));
}

static chunk *take_chunk(queue *q, chunk *before) {
  chunk *taken = q->unused;
  if (taken == NULL) {
    taken = &q->chunks[q->used++];
  } else {
    q->unused = taken->before;
  }
  taken->before = before;
  taken->count = 0;
  return taken;
}

/* Adds the entries whose bits are set to those of a batch. */
static inline void join_queue(queue *q, int32_t batch, uint32_t bits, fum_vf column, fum_vf row, fum_vf range,
                              fum_vu index) {
  chunk *last = q->last[batch];
  if (last == NULL || last->count >= CHUNK) q->last[batch] = last = take_chunk(q, last);
  const fum_vf packed = fum_vf_pack((fum_vf)index, bits);
  fum_vf_store(last->columns + last->count, fum_vf_pack(column, bits));
  fum_vf_store(last->rows + last->count, fum_vf_pack(row, bits));
  fum_vf_store(last->ranges + last->count, fum_vf_pack(range, bits));
  memcpy(last->indices + last->count, &packed, sizeof packed);
  last->count += __builtin_popcount(bits);
  q->waiting += __builtin_popcount(bits);
}

/* Takes the receivers of a batch off. */
static void drop_queue(queue *q, int32_t batch) {
  for (chunk *c = q->last[batch], *before; c != NULL; c = before) {
    before = c->before;
    q->waiting -= c->count;
    c->before = q->unused;
    q->unused = c;
  }
  q->last[batch] = NULL;
}
