/* FMI 2.0 co-simulation interface. */
#include "fmi2Functions.h"
#include "instance.h"

static void log_message(const Instance *instance, Status status, const char *message) {
    fmi2CallbackLogger logger = (fmi2CallbackLogger)instance->host_log;
    if (logger)
        logger(instance->host, instance->name, (fmi2Status)status,
               status == WARNING ? "logStatusWarning" : "logStatusError", "%s", message);
}

static fmi2Status refuse(fmi2Component c, const char *function) {
    return (fmi2Status)report(c, ERROR, "%s is not supported", function);
}

#define REFUSED(name, ...) \
    fmi2Status name(__VA_ARGS__) { return refuse(c, #name); }

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }
const char *fmi2GetVersion(void) { return fmi2Version; }

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)c, (void)on, (void)n, (void)categories; /* only warnings and errors are logged, and these always */
    return fmi2OK;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *callbacks, fmi2Boolean visible, fmi2Boolean logging) {
    (void)visible, (void)logging;
    if (type != fmi2CoSimulation) return NULL;
    return instance_create(name, guid, resources, log_message, callbacks ? (void (*)(void))callbacks->logger : NULL,
                           callbacks ? callbacks->componentEnvironment : NULL);
}

void fmi2FreeInstance(fmi2Component c) { instance_free(c); }

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean has_tolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean has_stop, fmi2Real stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return (fmi2Status)start_time(c, start);
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    return (fmi2Status)change_mode(c, INSTANTIATED, INITIALISING, __func__);
}
fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    return (fmi2Status)change_mode(c, INITIALISING, STEPPING, __func__);
}
fmi2Status fmi2Terminate(fmi2Component c) { return (fmi2Status)change_mode(c, STEPPING, TERMINATED, __func__); }
fmi2Status fmi2Reset(fmi2Component c) {
    instance_reset(c);
    return fmi2OK;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2Real value[]) {
    return (fmi2Status)get_values(c, vr, n, value);
}
fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2Real value[]) {
    return (fmi2Status)set_values(c, vr, n, value);
}

#define REFUSED_TYPE(Type) \
    fmi2Status fmi2Get##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, fmi2##Type value[]) { \
        (void)vr, (void)value; \
        return n ? refuse(c, "fmi2Get" #Type) : fmi2OK; \
    } \
    fmi2Status fmi2Set##Type(fmi2Component c, const fmi2ValueReference vr[], size_t n, const fmi2##Type value[]) { \
        (void)vr, (void)value; \
        return n ? refuse(c, "fmi2Set" #Type) : fmi2OK; \
    }
REFUSED_TYPE(Integer)
REFUSED_TYPE(Boolean)
REFUSED_TYPE(String)

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) { return (fmi2Status)save_state(c, state); }
fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { return (fmi2Status)restore_state(c, state); }
fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi2OK;
}
fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    if (!state) return (fmi2Status)report(c, ERROR, "there is no state");
    *size = state_size(state);
    return fmi2OK;
}
fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    return (fmi2Status)serialise(c, state, bytes, size);
}
fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    return (fmi2Status)deserialise(c, bytes, size, state);
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    return (fmi2Status)directional_derivative(c, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real duration, fmi2Boolean no_rollback) {
    (void)no_rollback;
    return (fmi2Status)do_step(c, time, duration);
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (kind != fmi2LastSuccessfulTime) return fmi2Discard;
    *value = ((Instance *)c)->data.values[TIME];
    return fmi2OK;
}
fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    (void)c;
    if (kind != fmi2Terminated) return fmi2Discard;
    *value = fmi2False;
    return fmi2OK;
}
fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)c, (void)kind, (void)value; /* no step is ever pending */
    return fmi2Discard;
}
fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}
fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)c, (void)kind, (void)value;
    return fmi2Discard;
}

REFUSED(fmi2CancelStep, fmi2Component c)
REFUSED(fmi2SetRealInputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
        const fmi2Integer order[], const fmi2Real value[])
REFUSED(fmi2GetRealOutputDerivatives, fmi2Component c, const fmi2ValueReference vr[], size_t n,
        const fmi2Integer order[], fmi2Real value[])

/* Model exchange: exported so that importers that look up every function can load the binary. */
REFUSED(fmi2EnterEventMode, fmi2Component c)
REFUSED(fmi2NewDiscreteStates, fmi2Component c, fmi2EventInfo *info)
REFUSED(fmi2EnterContinuousTimeMode, fmi2Component c)
REFUSED(fmi2CompletedIntegratorStep, fmi2Component c, fmi2Boolean no_rollback, fmi2Boolean *event, fmi2Boolean *end)
REFUSED(fmi2SetTime, fmi2Component c, fmi2Real time)
REFUSED(fmi2SetContinuousStates, fmi2Component c, const fmi2Real x[], size_t n)
REFUSED(fmi2GetDerivatives, fmi2Component c, fmi2Real derivatives[], size_t n)
REFUSED(fmi2GetEventIndicators, fmi2Component c, fmi2Real indicators[], size_t n)
REFUSED(fmi2GetContinuousStates, fmi2Component c, fmi2Real x[], size_t n)
REFUSED(fmi2GetNominalsOfContinuousStates, fmi2Component c, fmi2Real nominals[], size_t n)
