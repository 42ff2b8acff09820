/* One instance of a model, as FMI 2.0 and FMI 3.0 both see it. Status values are those of both standards. */
#ifndef INSTANCE_H
#define INSTANCE_H

#include <stddef.h>
#include <stdint.h>
#include "model.h"

typedef enum { OK, WARNING, DISCARD, ERROR } Status;
typedef enum { INSTANTIATED, INITIALISING, STEPPING, TERMINATED } Mode;

/* Everything that a state save has to keep, without padding: saved, restored and serialised by memcpy. */
typedef struct {
    char token[40];
    int64_t mode;
    int64_t stale; /* outputs do not yet belong to the other values */
    double values[N_VARIABLES];
} Data;

typedef struct Instance Instance;
struct Instance {
    Data data;
    char *name;
    void (*log)(const Instance *instance, Status status, const char *message);
    void (*host_log)(void); /* the host's function, cast back by `log` */
    void *host;
};

/* NULL if the token belongs to another build or memory is short; the reason is logged. */
Instance *instance_create(const char *name, const char *token,
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
Status do_step(Instance *instance, double time, double duration);

Status save_state(const Instance *instance, void **state);
Status restore_state(Instance *instance, const void *state);
Status serialise(const Instance *instance, const void *state, void *bytes, size_t size);
Status deserialise(const Instance *instance, const void *bytes, size_t size, void **state);

/* sensitivity = d unknowns / d knowns * seed, by fourth-order central differences of the core. */
Status directional_derivative(Instance *instance, const uint32_t unknowns[], size_t n_unknowns,
                              const uint32_t knowns[], size_t n_knowns, const double seed[], double sensitivity[]);

#endif
