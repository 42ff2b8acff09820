/* The compiled controller as the engine of an instance; resources/controller.setup is what it is created from. */
#include <stdio.h>
#include <string.h>
#ifdef _WIN32
#include <windows.h>
#endif
#include "instance.h"
#include "sidestep.h"

enum { FROM_COMMAND, FROM_PLAN };
enum { NUMBERS, INTEGERS, FLAGS };

typedef struct { /* where an output, or an array of them, stands in a record */
    uint32_t reference;
    int record, type;
    size_t offset, count, stride;
} Source;

static const Source SOURCES[] = OUTPUT_SOURCES;

typedef struct {
    sidestep *controller;
    unsigned char *memory; /* of the last save */
    sidestep_parameters held;
} Engine;

/* Path of the resources, from a path (FMI 3.0) or a file URI (FMI 2.0), without a slash at its end. */
static void decode_folder(const char *resources, char folder[], size_t size) {
    int uri = strncmp(resources, "file:", 5) == 0;
    const char *from = resources + (uri ? 5 : 0);
    size_t n = 0;
    if (uri && strncmp(from, "//", 2) == 0) from = strchr(from + 2, '/') ? strchr(from + 2, '/') : from + 2;
    if (uri && from[0] == '/' && from[1] && from[2] == ':') from++; /* a drive of Windows */
    while (*from && n + 1 < size) {
        unsigned code;
        if (uri && from[0] == '%' && sscanf(from + 1, "%2x", &code) == 1) {
            folder[n++] = (char)code;
            from += 3;
        } else {
            folder[n++] = *from++;
        }
    }
    while (n > 1 && (folder[n - 1] == '/' || folder[n - 1] == '\\')) n--;
    folder[n] = 0;
}

static FILE *open_file(const char *path) {
#ifdef _WIN32
    wchar_t wide[4400];
    if (!MultiByteToWideChar(CP_UTF8, 0, path, -1, wide, sizeof wide / sizeof *wide)) return NULL;
    return _wfopen(wide, L"rb");
#else
    return fopen(path, "rb");
#endif
}

static void *read_file(const char *path, size_t *size) {
    FILE *file = open_file(path);
    char *data = NULL;
    long length = file && !fseek(file, 0, SEEK_END) ? ftell(file) : -1;
    if (length >= 0 && !fseek(file, 0, SEEK_SET)) data = malloc((size_t)length + 1);
    *size = data ? fread(data, 1, (size_t)length, file) : 0;
    if (file) fclose(file);
    return data;
}

Status engine_open(Instance *instance, const char *resources) {
    char folder[4096], path[4200];
    const char *problem = "";
    size_t size;
    Engine *engine = calloc(1, sizeof *engine);
    instance->engine = engine;
    if (engine) engine->memory = malloc(sidestep_memory_size());
    if (!engine || !engine->memory) return report(instance, ERROR, "no memory for a controller");
    decode_folder(resources ? resources : "", folder, sizeof folder);
    snprintf(path, sizeof path, "%s/controller.setup", folder);
    void *setup = read_file(path, &size);
    if (!setup) return report(instance, ERROR, "%s cannot be read", path);
    engine->controller = sidestep_create(setup, size, &problem);
    free(setup);
    if (!engine->controller) return report(instance, ERROR, "%s: %s", path, problem);
    sidestep_get_parameters(engine->controller, &engine->held);
    return OK;
}

void engine_close(Instance *instance) {
    Engine *engine = instance->engine;
    if (!engine) return;
    sidestep_free(engine->controller);
    free(engine->memory);
    free(engine);
    instance->engine = NULL;
}

static Status tune(Instance *instance) {
    Engine *engine = instance->engine;
    sidestep_parameters given;
    memcpy(&given, &instance->data.values[FIRST_PARAMETER], sizeof given);
    given.input_delay_steps = floor(given.input_delay_steps + 0.5);
    if (!memcmp(&given, &engine->held, sizeof given)) return OK;
    if (sidestep_set_parameters(engine->controller, &given)) return report(instance, ERROR, "a parameter is out of range");
    engine->held = given;
    return OK;
}

static double read_number(const char *at, int type) {
    int64_t integer;
    double number;
    if (type == FLAGS) return *(const unsigned char *)at;
    if (type == INTEGERS) {
        memcpy(&integer, at, sizeof integer);
        return (double)integer;
    }
    memcpy(&number, at, sizeof number);
    return number;
}

static void write_outputs(double values[], const sidestep_command *command, const sidestep_plan *plan) {
    for (size_t i = 0; i < sizeof SOURCES / sizeof *SOURCES; i++) {
        const Source *from = &SOURCES[i];
        const char *record = from->record == FROM_PLAN ? (const char *)plan : (const char *)command;
        for (size_t k = 0; record && k < from->count; k++)
            values[from->reference + k] = read_number(record + from->offset + k * from->stride, from->type);
    }
}

static Status answer(Instance *instance, double time) {
    static const char *const WHY[] = {"", "state or obstacle is not a number of its range", "too many obstacles",
                                      "too many obstacles for its memory"};
    double *values = instance->data.values;
    Engine *engine = instance->engine;
    sidestep_state state;
    sidestep_command command;
    sidestep_obstacle obstacles[OBSTACLE_ROOM];
    Status status = tune(instance);
    if (status) return status;
    state.time = time;
    memcpy(&state.x, &values[FIRST_SIGNAL], sizeof state - sizeof state.time);
    size_t count = values[OBSTACLE_COUNT] >= 0.0 ? (size_t)(values[OBSTACLE_COUNT] + 0.5) : SIZE_MAX; /* if no number */
    for (size_t i = 0; i < count && i < OBSTACLE_ROOM; i++) {
        double *field = (double *)&obstacles[i];
        for (int k = 0; k < OBSTACLE_FIELDS; k++) field[k] = values[FIRST_OBSTACLE + k * OBSTACLE_ROOM + i];
    }
    int used = sidestep_step(engine->controller, &state, obstacles, count, &command);
    double distance = sidestep_clearance(engine->controller, &state, obstacles, count);
    write_outputs(values, &command, sidestep_last_plan(engine->controller));
    if (isfinite(distance)) values[CLEARANCE] = distance;
    values[SAMPLE_TIME] = time;
    return used ? report(instance, WARNING, "the inputs at %g s were not used: %s", time, WHY[used]) : OK;
}

/* Before the first step, u(t0) follows every change; later, a sample is held. */
Status engine_refresh(Instance *instance) {
    Data *data = &instance->data;
    if (data->mode == INSTANTIATED) return OK;
    if (!data->moved) sidestep_reset(((Engine *)instance->engine)->controller);
    Status status = data->moved ? OK : answer(instance, data->values[TIME]);
    if (status <= WARNING) data->stale = 0;
    return status;
}

Status engine_step(Instance *instance, double time, double duration) {
    Data *data = &instance->data;
    (void)duration;
    if (!data->moved) return data->stale ? engine_refresh(instance) : OK;
    if (time < data->values[SAMPLE_TIME] + data->values[PERIOD] * (1.0 - 1e-6)) return OK;
    data->stale = 0;
    return answer(instance, time);
}

Status engine_save(Instance *instance, const void **memory, size_t *size) {
    Engine *engine = instance->engine;
    if (instance->data.mode == INSTANTIATED || (instance->data.stale && !instance->data.moved)) return OK;
    *memory = engine->memory;
    *size = sidestep_memory_size();
    sidestep_save(engine->controller, engine->memory, *size);
    return OK;
}

Status engine_restore(Instance *instance, const void *memory, size_t size) {
    Engine *engine = instance->engine;
    if (size && sidestep_restore(engine->controller, memory, size))
        return report(instance, ERROR, "the saved memory is of another version, or damaged");
    return OK;
}

Status directional_derivative(Instance *instance, const uint32_t unknowns[], size_t n_unknowns,
                              const uint32_t knowns[], size_t n_knowns, const double seed[], double sensitivity[]) {
    (void)unknowns, (void)n_unknowns, (void)knowns, (void)n_knowns, (void)seed, (void)sensitivity;
    return report(instance, ERROR, "the controller has no directional derivatives");
}
