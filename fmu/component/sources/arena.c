/* What compiled kernels need of numba's run-time library: memory from an arena, and error paths that only note it. */
#include "arena.h"
#include <stdint.h>
#include <string.h>

enum { ALIGNMENT = 64 };

#if defined __linux__ && defined __GLIBC__
#define STATIC_TLS __attribute__((tls_model("initial-exec"))) /* the other model may call malloc at a thread's first use */
#else
#define STATIC_TLS
#endif
static _Thread_local Arena *arena STATIC_TLS;

void arena_enter(Arena *entered) {
    arena = entered;
    if (entered) entered->used = 0, entered->failed = 0;
}

static void *take(size_t size) {
    size_t from = arena->used, room = arena->size - from;
    size_t rounded = (size + ALIGNMENT - 1) & ~(size_t)(ALIGNMENT - 1);
    if (rounded < size || rounded > room) {
        arena->failed = 1;
        return NULL;
    }
    arena->used = from + rounded;
    if (arena->used > arena->peak) arena->peak = arena->used;
    return arena->base + from;
}

typedef struct { /* as numba's NRT_MemInfo: kernels read `data` */
    size_t count;
    void *destructor, *information, *data;
    size_t size;
    void *allocator;
} Block;

static Block *new_block(size_t size) {
    Block *block = take(sizeof *block);
    void *data = block ? take(size ? size : 1) : NULL;
    if (!data) return NULL;
    *block = (Block){1, NULL, NULL, data, size, NULL};
    return block;
}

void *sidestep_NRT_MemInfo_alloc(size_t size) { return new_block(size); }
void *sidestep_NRT_MemInfo_alloc_aligned(size_t size, uint32_t alignment) {
    (void)alignment; /* numba asks for 32 at most */
    return new_block(size);
}
void *sidestep_NRT_MemInfo_new_varsize_dtor(size_t size, void *destructor) {
    (void)destructor;
    return new_block(size);
}
void *sidestep_NRT_MemInfo_varsize_realloc(Block *block, size_t size) {
    void *data = take(size);
    if (!data) return NULL;
    memcpy(data, block->data, block->size < size ? block->size : size);
    block->data = data;
    block->size = size;
    return data;
}
void sidestep_NRT_MemInfo_call_dtor(void *block) { (void)block; }
void *sidestep_NRT_Allocate(size_t size) { return take(size); }
void sidestep_NRT_Free(void *pointer) { (void)pointer; }

/* Contiguous arrays only, which are all that kernels reshape. */
int sidestep_numba_attempt_nocopy_reshape(intptr_t n, const intptr_t *shape, const intptr_t *strides, intptr_t n_new,
                                          const intptr_t *new_shape, intptr_t *new_strides, intptr_t item,
                                          int fortran) {
    intptr_t stride = item;
    for (intptr_t i = n - 1; i >= 0; i--) {
        if (shape[i] != 1 && strides[i] != stride) return 0;
        stride *= shape[i];
    }
    if (fortran) return 0;
    stride = item;
    for (intptr_t i = n_new - 1; i >= 0; i--) {
        new_strides[i] = stride;
        stride *= new_shape[i];
    }
    return 1;
}

/* The rest is reached when a kernel raises an error: Python's functions are not there, the step has failed. */
#define FAILS(name) \
    void *sidestep_##name(void) { \
        arena->failed = 1; \
        return NULL; \
    }
FAILS(PyBytes_FromStringAndSize)
FAILS(PyErr_Clear)
FAILS(PyErr_SetNone)
FAILS(PyErr_SetString)
FAILS(PyErr_WriteUnraisable)
FAILS(PyObject_Hash)
FAILS(PyTuple_Pack)
FAILS(PyUnicode_FromKindAndData)
FAILS(PyUnicode_FromString)
FAILS(Py_DecRef)
FAILS(numba_do_raise)
FAILS(numba_gil_ensure)
FAILS(numba_gil_release)
FAILS(numba_runtime_build_excinfo_struct)
FAILS(numba_unpickle)

void *sidestep_PyExc_RuntimeError, *sidestep_PyExc_StopIteration, *sidestep_PyExc_SystemError,
    *sidestep_PyExc_ValueError, *sidestep_PyExc_ZeroDivisionError, *sidestep_PyExc_MemoryError,
    *sidestep_PyExc_IndexError, *sidestep_PyExc_AssertionError, *sidestep_PyExc_OverflowError,
    *sidestep_PyExc_TypeError;
