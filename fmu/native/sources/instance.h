/* One instance of a model, as FMI 2.0 and FMI 3.0 both see it. Status values are those of both standards. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include "variables.h"

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status;
typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Mode;
typedef enum {
    TIME_KIND, INPUT_KIND, STATE_KIND, HIDDEN_STATE_KIND, DERIVATIVE_KIND, OUTPUT_KIND, SAMPLED_KIND, TUNABLE_KIND,
    FIXED_KIND, CONSTANT_KIND
} Kind;

typedef struct {
    const char *name;
    Kind kind;
    double start;
    double minimum, maximum;
    uint32_t span; /* elements of the array that begins here, 1 of a scalar, 0 within an array */
} Variable;

extern const Variable VARIABLES[N_VARIABLES];

typedef struct {
    char token[40];
    int64_t mode;
    int64_t stale; /* outputs do not yet belong to the other values */
    int64_t moved; /* a step has been made */
    double values[N_VARIABLES];
} Data;

/* What a state save keeps, without padding: saved, restored and serialised by memcpy. */
typedef struct {
    Data data;
    uint64_t size;
    unsigned char memory[]; /* what the engine keeps beside the values */
} State;

typedef struct Instance Instance;
struct Instance {
    Data data;
    char *name;
    void (*log)(const Instance *instance, Status status, const char *message);
    void (*host_log)(void); /* the host's function, cast back by `log` */
    void *host;
    void *engine;
};

/* NULL if the token belongs to another build, memory is short or the engine does not start; the reason is logged. */
Instance *instance_create(const char *name, const char *token, const char *resources,
                          void (*log)(const Instance *, Status, const char *), void (*host_log)(void), void *host);
void instance_free(Instance *instance);
void instance_reset(Instance *instance);

/* Logs a printf-like message and returns `status`. */
Status report(const Instance *instance, Status status, const char *format, ...);

/* Moves to mode `to` if the present mode is `from`. */
Status change_mode(Instance *instance, Mode from, Mode to, const char *function);
Status start_time(Instance *instance, double time);

Status get_values(Instance *instance, const uint32_t references[], size_t n, double values[]);
Status set_values(Instance *instance, const uint32_t references[], size_t n, const double values[]);

/* The same where a reference stands for a whole array, as in FMI 3.0; `size` counts the values. */
Status get_arrays(Instance *instance, const uint32_t references[], size_t n, double values[], size_t size);
Status set_arrays(Instance *instance, const uint32_t references[], size_t n, const double values[], size_t size);
Status do_step(Instance *instance, double time, double duration);

Status save_state(Instance *instance, void **state);
Status restore_state(Instance *instance, const void *state);
Status serialise(const Instance *instance, const void *state, void *bytes, size_t size);
Status deserialise(const Instance *instance, const void *bytes, size_t size, void **state);

Status check_references(const Instance *instance, const uint32_t references[], size_t n);
size_t state_size(const void *state);

/* The rest is by the engine: plant.c, or controller_fmu.c for the controller. */

Status engine_open(Instance *instance, const char *resources);
void engine_close(Instance *instance);

/* Makes the outputs belong to the other values, so far as the mode allows; clears `stale`. */
Status engine_refresh(Instance *instance);
Status engine_step(Instance *instance, double time, double duration);

/* Memory beside the values, valid until the next call; and back again. */
Status engine_save(Instance *instance, const void **memory, size_t *size);
Status engine_restore(Instance *instance, const void *memory, size_t size);

/* sensitivity = d unknowns / d knowns * seed. */
Status directional_derivative(Instance *instance, const uint32_t unknowns[], size_t n_unknowns,
                              const uint32_t knowns[], size_t n_knowns, const double seed[], double sensitivity[]);

#endif
