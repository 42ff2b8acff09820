#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include "instance.h"

const Variable VARIABLES[N_VARIABLES] = VARIABLE_ROWS;

static const char *const MODES[] = {"before initialisation", "during initialisation", "between steps",
                                    "after termination"};

Status report(const Instance *instance, Status status, const char *format, ...) {
    char message[1024];
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

Instance *instance_create(const char *name, const char *token, const char *resources,
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
    if (engine_open(instance, resources)) {
        instance_free(instance);
        return NULL;
    }
    return instance;
}

void instance_free(Instance *instance) {
    if (!instance) return;
    engine_close(instance);
    free(instance->name);
    free(instance);
}

static Status refresh(Instance *instance) { return instance->data.stale ? engine_refresh(instance) : OK; }

Status change_mode(Instance *instance, Mode from, Mode to, const char *function) {
    if (instance->data.mode != (int64_t)from)
        return report(instance, ERROR, "%s must not be called %s", function, MODES[instance->data.mode]);
    Status status = from == INITIALISING ? refresh(instance) : OK;
    if (status <= WARNING) instance->data.mode = to;
    return status;
}

Status start_time(Instance *instance, double time) {
    if (!isfinite(time)) return report(instance, ERROR, "the start time must be a finite number");
    instance->data.values[TIME] = time;
    return OK;
}

Status check_references(const Instance *instance, const uint32_t references[], size_t n) {
    for (size_t i = 0; i < n; i++)
        if (references[i] >= N_VARIABLES)
            return report(instance, ERROR, "there is no variable with value reference %u", (unsigned)references[i]);
    return OK;
}

Status get_values(Instance *instance, const uint32_t references[], size_t n, double values[]) {
    int evaluate = instance->data.mode < STEPPING; /* later, states, inputs and parameters are up to date */
    if (check_references(instance, references, n)) return ERROR;
    for (size_t i = 0; i < n; i++) {
        Kind kind = VARIABLES[references[i]].kind;
        if (kind == DERIVATIVE_KIND || kind == OUTPUT_KIND || kind == SAMPLED_KIND) evaluate = 1;
    }
    Status status = evaluate ? refresh(instance) : OK;
    for (size_t i = 0; i < n; i++) values[i] = instance->data.values[references[i]];
    return status;
}

/* OK, WARNING: keep the value there is, ERROR. */
static Status check_value(const Instance *instance, uint32_t reference, double value) {
    const Variable *variable = &VARIABLES[reference];
    Mode mode = (Mode)instance->data.mode;
    if (variable->kind != INPUT_KIND && variable->kind != TUNABLE_KIND && variable->kind != FIXED_KIND)
        return report(instance, ERROR, "%s is not an input or a parameter", variable->name);
    if (mode == TERMINATED || (variable->kind == FIXED_KIND && mode > INITIALISING))
        return report(instance, ERROR, "%s must not be set %s", variable->name, MODES[mode]);
    if (isnan(value) && variable->kind == INPUT_KIND && TAKES_NAN) return OK; /* not measured */
    if (!isfinite(value) && variable->kind == INPUT_KIND)
        return report(instance, WARNING, "%s is not a finite number: the former value is kept", variable->name);
    if (!isfinite(value)) return report(instance, ERROR, "%s must be a finite number", variable->name);
    if (value < variable->minimum)
        return report(instance, ERROR, "%s must be at least %g, not %g", variable->name, variable->minimum, value);
    if (value > variable->maximum)
        return report(instance, ERROR, "%s must be at most %g, not %g", variable->name, variable->maximum, value);
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

static Status check_spans(const Instance *instance, const uint32_t references[], size_t n, size_t size) {
    if (check_references(instance, references, n)) return ERROR;
    for (size_t i = 0; i < n; i++) {
        size_t span = VARIABLES[references[i]].span;
        if (!span || span > size) return report(instance, ERROR, "a number of values that is not that of the variables");
        size -= span;
    }
    return size ? report(instance, ERROR, "more values than the variables have") : OK;
}

Status get_arrays(Instance *instance, const uint32_t references[], size_t n, double values[], size_t size) {
    Status worst = check_spans(instance, references, n, size);
    for (size_t i = 0; i < n && worst < ERROR; i++)
        for (uint32_t k = 0; k < VARIABLES[references[i]].span; k++) {
            uint32_t reference = references[i] + k;
            Status status = get_values(instance, &reference, 1, values++);
            if (status > worst) worst = status;
        }
    return worst;
}

Status set_arrays(Instance *instance, const uint32_t references[], size_t n, const double values[], size_t size) {
    Status worst = check_spans(instance, references, n, size);
    for (size_t i = 0; i < n && worst < ERROR; i++)
        for (uint32_t k = 0; k < VARIABLES[references[i]].span && worst < ERROR; k++) {
            uint32_t reference = references[i] + k;
            Status status = set_values(instance, &reference, 1, values++);
            if (status > worst) worst = status;
        }
    return worst;
}

Status do_step(Instance *instance, double time, double duration) {
    Data *data = &instance->data;
    double now = data->values[TIME];
    if (data->mode != STEPPING)
        return report(instance, ERROR, "doStep must not be called %s", MODES[data->mode]);
    if (!(isfinite(duration) && duration > 0.0))
        return report(instance, ERROR, "the communication step must be positive, not %g s", duration);
    if (!(fabs(time - now) <= 1e-6 * (1.0 + fabs(time))))
        return report(instance, ERROR, "the step starts at %.9g s, but the model is at %.9g s", time, now);
    data->values[TIME] = time; /* as the host counts it */
    Status status = engine_step(instance, time, duration);
    if (status > WARNING) return status;
    data->values[TIME] = time + duration;
    data->moved = 1;
    return status;
}

static Status copy_state(const Instance *instance, State **target, const Data *data, const void *memory, size_t size) {
    State *copy = realloc(*target, sizeof(State) + size);
    if (!copy) return report(instance, ERROR, "no memory for a state");
    *target = copy;
    copy->data = *data;
    copy->size = size;
    if (size) memcpy(copy->memory, memory, size);
    return OK;
}

size_t state_size(const void *state) { return sizeof(State) + (size_t)((const State *)state)->size; }

Status save_state(Instance *instance, void **state) {
    const void *memory = NULL;
    size_t size = 0;
    Status status = engine_save(instance, &memory, &size);
    return status ? status : copy_state(instance, (State **)state, &instance->data, memory, size);
}

Status restore_state(Instance *instance, const void *state) {
    const State *saved = state;
    if (!saved) return report(instance, ERROR, "there is no state to restore");
    Status status = engine_restore(instance, saved->memory, (size_t)saved->size);
    if (status == OK) instance->data = saved->data;
    return status;
}

Status serialise(const Instance *instance, const void *state, void *bytes, size_t size) {
    if (!state) return report(instance, ERROR, "there is no state to serialise");
    if (size < state_size(state))
        return report(instance, ERROR, "the state needs %lu bytes", (unsigned long)state_size(state));
    memcpy(bytes, state, state_size(state));
    return OK;
}

Status deserialise(const Instance *instance, const void *bytes, size_t size, void **state) {
    State head;
    if (size >= sizeof(State)) memcpy(&head, bytes, sizeof(State));
    if (size < sizeof(State) || size - sizeof(State) != head.size ||
        memcmp(head.data.token, instance->data.token, sizeof head.data.token) != 0)
        return report(instance, ERROR, "the serialised state was made by another build");
    return copy_state(instance, (State **)state, &head.data, (const char *)bytes + sizeof(State), (size_t)head.size);
}
