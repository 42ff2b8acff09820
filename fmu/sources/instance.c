#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "instance.h"

static const Variable VARIABLES[N_VARIABLES] = VARIABLE_ROWS;

static const char *const MODES[] = {"before initialisation", "during initialisation", "between steps",
                                    "after termination"};

Status report(const Instance *instance, Status status, const char *format, ...) {
    char message[256];
    va_list arguments;
    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    instance->log(instance, status, message);
    return status;
}

void instance_reset(Instance *instance) {
    memset(&instance->data, 0, sizeof instance->data);
    strncpy(instance->data.token, MODEL_TOKEN, sizeof instance->data.token - 1);
    for (int i = 0; i < N_VARIABLES; i++) instance->data.values[i] = VARIABLES[i].start;
    instance->data.stale = 1;
}

Instance *instance_create(const char *name, const char *token,
                          void (*log)(const Instance *, Status, const char *), void (*host_log)(void), void *host) {
    Instance *instance = calloc(1, sizeof *instance);
    if (!instance) return NULL;
    instance->log = log;
    instance->host_log = host_log;
    instance->host = host;
    instance->name = calloc(strlen(name ? name : "") + 1, 1);
    if (instance->name) strcpy(instance->name, name ? name : "");
    if (!instance->name || !token || strcmp(token, MODEL_TOKEN) != 0) {
        report(instance, ERROR, "the binary belongs to another modelDescription.xml: its token is " MODEL_TOKEN);
        instance_free(instance);
        return NULL;
    }
    instance_reset(instance);
    return instance;
}

void instance_free(Instance *instance) {
    if (!instance) return;
    free(instance->name);
    free(instance);
}

Status change_mode(Instance *instance, Mode from, Mode to, const char *function) {
    if (instance->data.mode != (int64_t)from)
        return report(instance, ERROR, "%s must not be called %s", function, MODES[instance->data.mode]);
    if (from == INITIALISING) model_initialise(instance->data.values);
    instance->data.mode = to;
    return OK;
}

Status start_time(Instance *instance, double time) {
    if (!isfinite(time)) return report(instance, ERROR, "the start time must be a finite number");
    instance->data.values[TIME] = time;
    return OK;
}

static Status check_references(const Instance *instance, const uint32_t references[], size_t n) {
    for (size_t i = 0; i < n; i++)
        if (references[i] >= N_VARIABLES)
            return report(instance, ERROR, "there is no variable with value reference %u", (unsigned)references[i]);
    return OK;
}

static void refresh(Data *data) {
    if (!data->stale) return;
    if (data->mode < STEPPING) model_initialise(data->values);
    model_evaluate(data->values);
    data->stale = 0;
}

Status get_values(Instance *instance, const uint32_t references[], size_t n, double values[]) {
    if (check_references(instance, references, n)) return ERROR;
    refresh(&instance->data);
    for (size_t i = 0; i < n; i++) values[i] = instance->data.values[references[i]];
    return OK;
}

/* OK, WARNING: keep the value there is, ERROR. */
static Status check_value(const Instance *instance, uint32_t reference, double value) {
    const Variable *variable = &VARIABLES[reference];
    Mode mode = (Mode)instance->data.mode;
    if (variable->kind < INPUT_KIND || (variable->kind > INPUT_KIND && variable->kind < TUNABLE_KIND))
        return report(instance, ERROR, "%s is not an input or a parameter", variable->name);
    if (mode == TERMINATED || (variable->kind == FIXED_KIND && mode > INITIALISING))
        return report(instance, ERROR, "%s must not be set %s", variable->name, MODES[mode]);
    if (!isfinite(value) && variable->kind == INPUT_KIND)
        return report(instance, WARNING, "%s is not a finite number: the former value is kept", variable->name);
    if (!isfinite(value)) return report(instance, ERROR, "%s must be a finite number", variable->name);
    if (value < variable->minimum)
        return report(instance, ERROR, "%s must be at least %g, not %g", variable->name, variable->minimum, value);
    return OK;
}

Status set_values(Instance *instance, const uint32_t references[], size_t n, const double values[]) {
    Status worst = check_references(instance, references, n);
    for (size_t i = 0; i < n && worst < ERROR; i++) {
        Status status = check_value(instance, references[i], values[i]);
        if (status == OK) instance->data.values[references[i]] = values[i];
        if (status > worst) worst = status;
    }
    instance->data.stale = 1;
    return worst;
}

Status do_step(Instance *instance, double time, double duration) {
    Data *data = &instance->data;
    double before[N_VARIABLES], now = data->values[TIME];
    if (data->mode != STEPPING)
        return report(instance, ERROR, "doStep must not be called %s", MODES[data->mode]);
    if (!(isfinite(duration) && duration > 0.0))
        return report(instance, ERROR, "the communication step must be positive, not %g s", duration);
    if (!(fabs(time - now) <= 1e-6 * (1.0 + fabs(time))))
        return report(instance, ERROR, "the step starts at %.9g s, but the model is at %.9g s", time, now);
    memcpy(before, data->values, sizeof before);
    data->values[TIME] = time + duration;
    model_advance(data->values, duration);
    for (int i = FIRST_STATE; i < FIRST_STATE + N_STATES; i++) {
        if (isfinite(data->values[i])) continue;
        memcpy(data->values, before, sizeof before);
        return report(instance, DISCARD, "%s diverged within the step from %.9g s", VARIABLES[i].name, time);
    }
    data->stale = 1;
    return OK;
}

Status save_state(const Instance *instance, void **state) {
    if (!*state) *state = malloc(sizeof(Data));
    if (!*state) return report(instance, ERROR, "no memory for a state");
    memcpy(*state, &instance->data, sizeof(Data));
    return OK;
}

Status restore_state(Instance *instance, const void *state) {
    if (!state) return report(instance, ERROR, "there is no state to restore");
    memcpy(&instance->data, state, sizeof(Data));
    return OK;
}

Status serialise(const Instance *instance, const void *state, void *bytes, size_t size) {
    if (!state || size < sizeof(Data)) return report(instance, ERROR, "a state needs %u bytes", (unsigned)sizeof(Data));
    memcpy(bytes, state, sizeof(Data));
    return OK;
}

Status deserialise(const Instance *instance, const void *bytes, size_t size, void **state) {
    if (size != sizeof(Data) || memcmp(bytes, instance->data.token, sizeof instance->data.token) != 0)
        return report(instance, ERROR, "the serialised state was made by another build");
    if (!*state) *state = malloc(sizeof(Data));
    if (!*state) return report(instance, ERROR, "no memory for a state");
    memcpy(*state, bytes, sizeof(Data));
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
    refresh(&instance->data);
    for (size_t i = 0; i < n_unknowns; i++) sensitivity[i] = 0.0;
    for (size_t j = 0; j < n_knowns; j++)
        add_column(&instance->data, unknowns, n_unknowns, knowns[j], seed[j], sensitivity);
    return OK;
}
