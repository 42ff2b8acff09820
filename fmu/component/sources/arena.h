/* Memory of one step: taken piece by piece, given back as a whole before the next. */
#ifndef SIDESTEP_ARENA_H
#define SIDESTEP_ARENA_H

#include <stddef.h>

typedef struct {
    unsigned char *base;
    size_t size, used, peak;
    int failed; /* it was too small, or the code that was run raised an error */
} Arena;

/* Kernels that this thread runs from now on take their memory here; NULL for none. */
void arena_enter(Arena *arena);

#endif
