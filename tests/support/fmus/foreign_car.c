/* A car by somebody else, on our core: own value references, degrees and km/h, steering wheel with ratio 16 and
 * positive to the right, steps of 10 ms only, and no function of FMI 2.0 but those that every run needs. */
#include <stdlib.h>
#include <string.h>
#include "fmi2Functions.h"
#include "model.h"

static const double DEGREES = 57.29577951308232, RATIO = 16.0;
enum { HAND_WHEEL, SPEED_SET, POS_X, POS_Y, PSI, V_LONG, V_LAT, HAND_WHEEL_NOW, PSI_START, V_START, MODE };
static const int OURS[] = {STEER_ANGLE_COMMAND, TARGET_SPEED, X, Y, YAW, V_X, V_Y, STEER_ANGLE, YAW_0, V_X_0};

typedef struct {
    double v[N_VARIABLES];
    fmi2CallbackFunctions host;
    int mode;
} Car;

static double factor(fmi2ValueReference r) {
    if (r == HAND_WHEEL || r == HAND_WHEEL_NOW) return -RATIO * DEGREES;
    if (r == PSI || r == PSI_START) return DEGREES;
    return r == SPEED_SET || r == V_START || r == V_LONG ? 3.6 : 1.0;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    static const struct { int index; double value; } START[] = START_VALUES;
    (void)name, (void)type, (void)guid, (void)resources, (void)visible, (void)logging;
    Car *car = calloc(1, sizeof *car);
    for (size_t i = 0; i < sizeof START / sizeof *START; i++) car->v[START[i].index] = START[i].value;
    car->host = *callbacks;
    return car;
}
void fmi2FreeInstance(fmi2Component c) { free(c); }
fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean b, fmi2Real e, fmi2Real t, fmi2Boolean s, fmi2Real end) {
    (void)c, (void)b, (void)e, (void)t, (void)s, (void)end;
    return fmi2OK;
}
fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return (void)c, fmi2OK; }
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Car *car = c;
    model_initialise(car->v);
    return car->mode == 2 ? fmi2OK : fmi2Error; /* sport mode is the only one that drives */
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) ((Car *)c)->v[OURS[r[i]]] = value[i] / factor(r[i]);
    return fmi2OK;
}
fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real value[]) {
    for (size_t i = 0; i < n; i++) {
        value[i] = ((Car *)c)->v[OURS[r[i]]] * factor(r[i]);
        if (r[i] == PSI) value[i] = remainder(value[i], 360.0);
    }
    return fmi2OK;
}
fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer value[]) {
    for (size_t i = 0; i < n; i++)
        if (r[i] == MODE) ((Car *)c)->mode = value[i];
    return fmi2OK;
}
fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real h, fmi2Boolean b) {
    Car *car = c;
    (void)time, (void)b;
    if (fabs(h - 0.01) > 1e-9) {
        car->host.logger(car->host.componentEnvironment, "car", fmi2Error, "step", "%s of %g s is not 10 ms", "step", h);
        return fmi2Error;
    }
    model_advance(car->v, h);
    return fmi2OK;
}
