/* A tiny car as an FMU of FMI 2.0 or 3.0 (-DFMI=2, 3), for importers to stumble over: each oddity is one more macro. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { STEER, SPEED, X, Y, YAW, VX, VY, RATE, DELTA, X0 = 10, MASS = 17, TYRE = 18, GAIN = 20, N = 24 };
static const double LENGTH = 2.579, REAR = 1.423, LAG = 0.05, FASTEST = 0.4;
#ifndef ANGLE
#define ANGLE 1.0 /* units of the steering and of the yaw per radian */
#endif
#ifndef FAST
#define FAST 1.0 /* units of the speeds per m/s */
#endif
#ifndef INNER
#define INNER 0.001 /* longest step of the integration [s] */
#endif

typedef struct {
    double v[N], time;
    char text[200];
    int number, log;
    void (*say)(void *car, const char *words);
    const void *host;
    void *environment;
} Car;

static int instances;

static void begin(Car *car) {
    for (int i = 0; i < 7; i++) car->v[X + i] = car->v[X0 + i];
#ifdef RESET_DROPS
    car->v[VY] = car->v[RATE] = 0.0;
#endif
}

static int starts(Car *car) {
    (void)car;
#ifdef NEEDS_TEXT
    if (strcmp(car->text, "roads/here.xodr")) return 0;
#endif
#ifdef NEEDS_NUMBER
    if (car->number != 2) return 0;
#endif
#ifdef NEEDS_GAIN
    if (car->v[GAIN] != 2.5) return 0;
#endif
#ifdef NEEDS_MASS
    if (car->v[MASS] != 1500.0 || car->v[TYRE] != 3.0) return 0;
#endif
    begin(car);
    return 1;
}

static void turn(Car *car, double h) {
    double *v = car->v, limit = 0.6, wish = fmin(fmax(v[STEER], -limit), limit);
    double pull = fmin(fmax(2.0 * (v[SPEED] - v[VX]), -8.0), 3.0);
    v[DELTA] += fmin(fmax((wish - v[DELTA]) * (1.0 - exp(-h / LAG)), -FASTEST * h), FASTEST * h);
    v[RATE] = v[VX] * tan(v[DELTA]) / LENGTH;
    v[VY] = REAR * v[RATE];
    v[X] += h * (v[VX] * cos(v[YAW]) - v[VY] * sin(v[YAW]));
    v[Y] += h * (v[VX] * sin(v[YAW]) + v[VY] * cos(v[YAW]));
    v[YAW] += h * v[RATE];
    v[VX] += h * pull;
}

static int advance(Car *car, double h) {
#ifdef ENDS
    if (car->time > 0.5) {
        car->say(car, "the tank is empty");
        return 0;
    }
#endif
#ifdef CRASHES
    if (car->time > 0.5) abort();
#endif
    int parts = (int)ceil(h / INNER - 1e-9);
    for (int i = 0; i < parts; i++) turn(car, h / parts);
    car->time += h;
#ifdef NAN_LATER
    if (car->time > 0.5) car->v[Y] = NAN;
#endif
    return 1;
}

static double factor(unsigned r) {
    if (r == STEER || r == YAW || r == RATE || r == DELTA || r == X0 + 2 || r == X0 + 5 || r == X0 + 6) return ANGLE;
    return r == SPEED || r == VX || r == X0 + 3 ? FAST : 1.0;
}

static double read(Car *car, unsigned r) { return car->v[r] * factor(r); }
static void store(Car *car, unsigned r, double value) { car->v[r] = value / factor(r); }

static Car *make(void) {
#ifdef ONCE
    if (instances) return NULL;
#endif
    instances++;
    Car *car = calloc(1, sizeof *car);
    car->v[SPEED] = car->v[X0 + 3] = 15.0;
    car->number = 1;
    return car;
}

#if FMI == 2
#include "fmi2Functions.h"
static void say2(void *c, const char *words) {
    Car *car = c;
    const fmi2CallbackFunctions *host = car->host;
    if (car->log) host->logger(car->environment, "odd", fmi2Error, "fuel", "%s", words);
}
#ifndef NO_TYPES
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String names[]) {
    (void)n, (void)names;
    ((Car *)c)->log = on;
    return fmi2OK;
}
#endif
fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String place,
                              const fmi2CallbackFunctions *host, fmi2Boolean visible, fmi2Boolean log) {
    (void)name, (void)type, (void)visible, (void)place;
#ifdef CHECKS_GUID
    if (strcmp(guid, "{right}")) return NULL;
#endif
    (void)guid;
    Car *car = make();
    if (!car) return NULL;
    car->host = host, car->environment = host->componentEnvironment, car->say = say2, car->log = log;
#ifdef NULL_LOG
    host->logger(car->environment, "odd", fmi2OK, NULL, NULL);
#endif
    return car;
}
void fmi2FreeInstance(fmi2Component c) {
#ifdef FREE_CRASHES
    abort();
#endif
    free(c);
}
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean b, fmi2Real e, fmi2Real t, fmi2Boolean s, fmi2Real end) {
    (void)b, (void)e, (void)s, (void)end;
#ifdef NEEDS_STOP
    if (!s || end <= t) return fmi2Error;
#endif
    ((Car *)c)->time = t;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return starts(c) ? fmi2OK : fmi2Error; }
#ifndef NO_TERMINATE
fmi2Status fmi2Terminate(fmi2Component c) {
    (void)c;
#ifdef TERMINATE_CRASHES
    abort();
#endif
    return fmi2OK;
}
#endif
#ifndef NO_RESET
fmi2Status fmi2Reset(fmi2Component c) {
    Car *car = c;
    memset(car->v, 0, sizeof car->v);
    return fmi2OK;
}
#endif
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) store(c, r[i], value[i]);
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) value[i] = read(c, r[i]);
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer value[]) {
    (void)r;
    if (n) ((Car *)c)->number = value[0];
    return fmi2OK;
}
fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean value[]) {
    (void)r;
    if (n) ((Car *)c)->number = value[0] ? 2 : 1;
    return fmi2OK;
}
fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String value[]) {
    (void)r;
    if (n) snprintf(((Car *)c)->text, sizeof((Car *)c)->text, "%s", value[0]);
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean b) {
    (void)b;
    Car *car = c;
    (void)time;
#ifdef STRICT_STEP
    if (fabs(h - 0.01) > 1e-9) return fmi2Error;
#endif
#ifdef DISCARDS
    if (h > 0.006) return fmi2Discard;
#endif
    return advance(car, h) ? fmi2OK : fmi2Error;
}
#else
#include "fmi3Functions.h"
static void say3(void *c, const char *words) {
    Car *car = c;
    if (car->log) ((fmi3LogMessageCallback)(size_t)car->host)(car->environment, fmi3Error, "fuel", words);
}
fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean log, fmi3Boolean events, fmi3Boolean early,
                                         const fmi3ValueReference need[], size_t needs,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback host,
                                         fmi3IntermediateUpdateCallback update) {
    (void)name, (void)token, (void)resources, (void)visible, (void)events, (void)early, (void)need, (void)needs;
    (void)update;
    Car *car = make();
    if (!car) return NULL;
    car->host = (const void *)(size_t)host, car->environment = environment, car->say = say3, car->log = log;
    return car;
}
void fmi3FreeInstance(fmi3Instance c) { free(c); }
fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean b, fmi3Float64 e, fmi3Float64 t, fmi3Boolean s,
                                       fmi3Float64 end) {
    (void)b, (void)e, (void)s, (void)end;
    ((Car *)c)->time = t;
    return fmi3OK;
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return starts(c) ? fmi3OK : fmi3Error; }
fmi3Status fmi3Terminate(fmi3Instance c) { return (void)c, fmi3OK; }
fmi3Status fmi3Reset(fmi3Instance c) { return (void)c, fmi3OK; }
/* An array takes as many values as it has elements: the steering and the speed, the pose. */
static size_t width(unsigned r) {
#ifdef ARRAYS
    if (r == X) return 3;
    if (r == STEER) return 2;
#endif
    (void)r;
    return 1;
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 value[], size_t m) {
    size_t k = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < width(r[i]); j++, k++)
            if (k < m) store(c, r[i] + j, value[k]);
    return k == m ? fmi3OK : fmi3Error;
}
fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 value[], size_t m) {
    size_t k = 0;
    for (size_t i = 0; i < n; i++)
        for (size_t j = 0; j < width(r[i]); j++, k++)
            if (k < m) value[k] = read(c, r[i] + j);
    return k == m ? fmi3OK : fmi3Error;
}
fmi3Status fmi3SetFloat32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float32 value[], size_t m) {
    for (size_t i = 0; i < n && i < m; i++) store(c, r[i], value[i]);
    return fmi3OK;
}
fmi3Status fmi3GetFloat32(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float32 value[], size_t m) {
    for (size_t i = 0; i < n && i < m; i++) value[i] = (float)read(c, r[i]);
    return fmi3OK;
}
fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3String value[], size_t m) {
    (void)r, (void)m;
    if (n) snprintf(((Car *)c)->text, sizeof((Car *)c)->text, "%s", value[0]);
    return fmi3OK;
}
fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 h, fmi3Boolean b, fmi3Boolean *event,
                      fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last) {
    (void)b;
    *event = *end = *early = fmi3False;
    *last = time + h;
    return advance(c, h) ? fmi3OK : fmi3Error;
}
#endif
