/* A plant core as the engine of an instance. */
#include <string.h>
#include "instance.h"
#include "model.h"

Status engine_open(Instance *instance, const char *resources) {
    (void)instance, (void)resources;
    return OK;
}

void engine_close(Instance *instance) { (void)instance; }

Status engine_refresh(Instance *instance) {
    Data *data = &instance->data;
    if (data->mode < STEPPING) model_initialise(data->values);
    model_evaluate(data->values);
    data->stale = 0;
    return OK;
}

Status engine_step(Instance *instance, double time, double duration) {
    Data *data = &instance->data;
    double before[N_VARIABLES];
    memcpy(before, data->values, sizeof before);
    model_advance(data->values, duration);
    for (int i = FIRST_STATE; i < FIRST_STATE + N_STATES; i++) {
        if (isfinite(data->values[i])) continue;
        memcpy(data->values, before, sizeof before);
        return report(instance, DISCARD, "%s diverged within the step from %.9g s", VARIABLES[i].name, time);
    }
    data->stale = 1;
    return OK;
}

Status engine_save(Instance *instance, const void **memory, size_t *size) {
    (void)instance, (void)memory, (void)size; /* the values are all there is */
    return OK;
}

Status engine_restore(Instance *instance, const void *memory, size_t size) {
    (void)instance, (void)memory, (void)size;
    return OK;
}

/* d unknown / d known by the five-point stencil, exact for polynomials of degree four. */
static void add_column(const Data *data, const uint32_t unknowns[], size_t n, uint32_t known, double seed,
                       double sensitivity[]) {
    static const double OFFSET[] = {-2.0, -1.0, 1.0, 2.0}, WEIGHT[] = {1.0, -8.0, 8.0, -1.0};
    double magnitude = fabs(data->values[known]), h = 1e-4 * (magnitude > 1.0 ? magnitude : 1.0);
    for (int k = 0; k < 4; k++) {
        double v[N_VARIABLES];
        memcpy(v, data->values, sizeof v);
        v[known] += OFFSET[k] * h;
        model_evaluate(v);
        for (size_t i = 0; i < n; i++) sensitivity[i] += seed * WEIGHT[k] * v[unknowns[i]] / (12.0 * h);
    }
}

Status directional_derivative(Instance *instance, const uint32_t unknowns[], size_t n_unknowns,
                              const uint32_t knowns[], size_t n_knowns, const double seed[], double sensitivity[]) {
    if (check_references(instance, unknowns, n_unknowns) || check_references(instance, knowns, n_knowns)) return ERROR;
    for (size_t j = 0; j < n_knowns; j++)
        if (VARIABLES[knowns[j]].kind == DERIVATIVE_KIND || VARIABLES[knowns[j]].kind == OUTPUT_KIND)
            return report(instance, ERROR, "%s is not a known", VARIABLES[knowns[j]].name);
    if (instance->data.stale) engine_refresh(instance);
    for (size_t i = 0; i < n_unknowns; i++) sensitivity[i] = 0.0;
    for (size_t j = 0; j < n_knowns; j++)
        add_column(&instance->data, unknowns, n_unknowns, knowns[j], seed[j], sensitivity);
    return OK;
}
