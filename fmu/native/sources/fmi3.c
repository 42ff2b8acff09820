/* FMI 3.0 co-simulation interface. */
#include "fmi3Functions.h"
#include <stdlib.h>
#include "instance.h"

static void log_message(const Instance *instance, Status status, const char *message) {
    fmi3LogMessageCallback logger = (fmi3LogMessageCallback)instance->host_log;
    if (logger)
        logger(instance->host, (fmi3Status)status, status == WARNING ? "logStatusWarning" : "logStatusError", message);
}

static fmi3Status refuse(fmi3Instance c, const char *function) {
    return (fmi3Status)report(c, ERROR, "%s is not supported", function);
}

#define REFUSED(name, ...) \
    fmi3Status name(__VA_ARGS__) { return refuse(c, #name); }

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    (void)c, (void)on, (void)n, (void)categories; /* only warnings and errors are logged, and these always */
    return fmi3OK;
}

fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean event_mode_used, fmi3Boolean early_return_allowed, const fmi3ValueReference intermediate[],
    size_t n_intermediate, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log,
    fmi3IntermediateUpdateCallback update) {
    (void)visible, (void)logging, (void)event_mode_used, (void)early_return_allowed;
    (void)intermediate, (void)n_intermediate, (void)update;
    return instance_create(name, token, resources, log_message, (void (*)(void))log, environment);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources,
                                          fmi3Boolean visible, fmi3Boolean logging,
                                          fmi3InstanceEnvironment environment, fmi3LogMessageCallback log) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)log;
    return NULL;
}

fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock) {
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)environment, (void)log;
    (void)update, (void)lock, (void)unlock;
    return NULL;
}

void fmi3FreeInstance(fmi3Instance c) { instance_free(c); }

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean has_tolerance, fmi3Float64 tolerance,
                                       fmi3Float64 start, fmi3Boolean has_stop, fmi3Float64 stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    if (start_time(c, start)) return fmi3Error;
    return (fmi3Status)change_mode(c, INSTANTIATED, INITIALISING, __func__);
}
fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    return (fmi3Status)change_mode(c, INITIALISING, STEPPING, __func__);
}
fmi3Status fmi3Terminate(fmi3Instance c) { return (fmi3Status)change_mode(c, STEPPING, TERMINATED, __func__); }
fmi3Status fmi3Reset(fmi3Instance c) {
    instance_reset(c);
    return fmi3OK;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 values[], size_t size) {
    return (fmi3Status)get_arrays(c, vr, n, values, size);
}
fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 values[],
                          size_t size) {
    return (fmi3Status)set_arrays(c, vr, n, values, size);
}

#define REFUSED_TYPE(Type) \
    fmi3Status fmi3Get##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3##Type values[], \
                             size_t size) { \
        (void)vr, (void)values, (void)size; \
        return n ? refuse(c, "fmi3Get" #Type) : fmi3OK; \
    } \
    fmi3Status fmi3Set##Type(fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3##Type values[], \
                             size_t size) { \
        (void)vr, (void)values, (void)size; \
        return n ? refuse(c, "fmi3Set" #Type) : fmi3OK; \
    }
REFUSED_TYPE(Float32)
REFUSED_TYPE(Int8)
REFUSED_TYPE(UInt8)
REFUSED_TYPE(Int16)
REFUSED_TYPE(UInt16)
REFUSED_TYPE(Int32)
REFUSED_TYPE(UInt32)
REFUSED_TYPE(Int64)
REFUSED_TYPE(UInt64)
REFUSED_TYPE(Boolean)
REFUSED_TYPE(String)

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) { return (fmi3Status)save_state(c, state); }
fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) { return (fmi3Status)restore_state(c, state); }
fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    (void)c;
    free(*state);
    *state = NULL;
    return fmi3OK;
}
fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    if (!state) return (fmi3Status)report(c, ERROR, "there is no state");
    *size = state_size(state);
    return fmi3OK;
}
fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    return (fmi3Status)serialise(c, state, bytes, size);
}
fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    return (fmi3Status)deserialise(c, bytes, size, state);
}

fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    if (n_seed != n_knowns || n_sensitivity != n_unknowns)
        return (fmi3Status)report(c, ERROR, "every variable is a scalar: one value each");
    return (fmi3Status)directional_derivative(c, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity);
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 duration, fmi3Boolean no_rollback,
                      fmi3Boolean *event, fmi3Boolean *end, fmi3Boolean *early, fmi3Float64 *last_time) {
    (void)no_rollback;
    fmi3Status status = (fmi3Status)do_step(c, time, duration);
    *event = *end = *early = fmi3False;
    *last_time = ((Instance *)c)->data.values[TIME];
    return status;
}

/* The rest: exported so that importers that look up every function can load the binary. */
REFUSED(fmi3GetBinary, fmi3Instance c, const fmi3ValueReference vr[], size_t n, size_t sizes[], fmi3Binary values[],
        size_t size)
REFUSED(fmi3SetBinary, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const size_t sizes[],
        const fmi3Binary values[], size_t size)
REFUSED(fmi3GetClock, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Clock values[])
REFUSED(fmi3SetClock, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Clock values[])
REFUSED(fmi3GetNumberOfVariableDependencies, fmi3Instance c, fmi3ValueReference vr, size_t *n)
REFUSED(fmi3GetVariableDependencies, fmi3Instance c, fmi3ValueReference dependent, size_t element[],
        fmi3ValueReference independents[], size_t elements[], fmi3DependencyKind kinds[], size_t n)
REFUSED(fmi3GetAdjointDerivative, fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[], size_t n_seed,
        fmi3Float64 sensitivity[], size_t n_sensitivity)
REFUSED(fmi3EnterConfigurationMode, fmi3Instance c)
REFUSED(fmi3ExitConfigurationMode, fmi3Instance c)
REFUSED(fmi3GetIntervalDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 intervals[],
        fmi3IntervalQualifier qualifiers[])
REFUSED(fmi3GetIntervalFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
        fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[])
REFUSED(fmi3GetShiftDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3Float64 shifts[])
REFUSED(fmi3GetShiftFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, fmi3UInt64 counters[],
        fmi3UInt64 resolutions[])
REFUSED(fmi3SetIntervalDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 intervals[])
REFUSED(fmi3SetIntervalFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],
        const fmi3UInt64 resolutions[])
REFUSED(fmi3SetShiftDecimal, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Float64 shifts[])
REFUSED(fmi3SetShiftFraction, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3UInt64 counters[],
        const fmi3UInt64 resolutions[])
REFUSED(fmi3EvaluateDiscreteStates, fmi3Instance c)
REFUSED(fmi3UpdateDiscreteStates, fmi3Instance c, fmi3Boolean *update, fmi3Boolean *end, fmi3Boolean *nominals,
        fmi3Boolean *values, fmi3Boolean *next_defined, fmi3Float64 *next)
REFUSED(fmi3EnterEventMode, fmi3Instance c)
REFUSED(fmi3EnterStepMode, fmi3Instance c)
REFUSED(fmi3GetOutputDerivatives, fmi3Instance c, const fmi3ValueReference vr[], size_t n, const fmi3Int32 orders[],
        fmi3Float64 values[], size_t size)
REFUSED(fmi3ActivateModelPartition, fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time)
REFUSED(fmi3EnterContinuousTimeMode, fmi3Instance c)
REFUSED(fmi3CompletedIntegratorStep, fmi3Instance c, fmi3Boolean no_rollback, fmi3Boolean *event, fmi3Boolean *end)
REFUSED(fmi3SetTime, fmi3Instance c, fmi3Float64 time)
REFUSED(fmi3SetContinuousStates, fmi3Instance c, const fmi3Float64 x[], size_t n)
REFUSED(fmi3GetContinuousStateDerivatives, fmi3Instance c, fmi3Float64 derivatives[], size_t n)
REFUSED(fmi3GetEventIndicators, fmi3Instance c, fmi3Float64 indicators[], size_t n)
REFUSED(fmi3GetContinuousStates, fmi3Instance c, fmi3Float64 x[], size_t n)
REFUSED(fmi3GetNominalsOfContinuousStates, fmi3Instance c, fmi3Float64 nominals[], size_t n)
REFUSED(fmi3GetNumberOfEventIndicators, fmi3Instance c, size_t *n)
REFUSED(fmi3GetNumberOfContinuousStates, fmi3Instance c, size_t *n)
