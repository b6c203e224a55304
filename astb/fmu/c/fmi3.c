/* The functions of FMI 3.0 for co-simulation; those of other interfaces say that there is none. */
#include "unit.h"

typedef void (*Logger)(void *, int, const char *, const char *);

static void say(Instance *me, int status, const char *message) {
    Logger logger = (Logger)me->logger;
    if (logger != NULL) {
        logger(me->environment, status, "logStatusError", message);
    }
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT int fmi3SetDebugLogging(void *me, bool on, size_t n, const char *const categories[]) {
    (void)me, (void)on, (void)n, (void)categories;
    return OK; /* errors are always told, and there is nothing else */
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
    bool logging, bool events, bool early, const uint32_t *between, size_t n, void *environment, Logger log,
    void *update) {
    (void)resources, (void)visible, (void)logging, (void)events, (void)early, (void)between, (void)n, (void)update;
    return unit_new(name, token, environment, (Callback)log, say);
}

EXPORT void *fmi3InstantiateModelExchange(void) { return NULL; }
EXPORT void *fmi3InstantiateScheduledExecution(void) { return NULL; }

EXPORT void fmi3FreeInstance(void *me) { unit_free(me); }

EXPORT int fmi3EnterInitializationMode(void *me, bool given, double tolerance, double begin, bool ends, double stop) {
    (void)given, (void)tolerance, (void)ends, (void)stop;
    return unit_begin(me, begin);
}

EXPORT int fmi3ExitInitializationMode(void *me) { return unit_initialized(me); }
EXPORT int fmi3Terminate(void *me) { return unit_end(me); }

EXPORT int fmi3Reset(void *me) {
    unit_reset(me);
    return OK;
}

static int fits(void *me, size_t n, size_t values) {
    return n == values ? OK : unit_refuse(me, "%zu variables and %zu values do not fit: all are scalars", n, values);
}

EXPORT int fmi3GetFloat64(void *me, const uint32_t *vr, size_t n, double *values, size_t count) {
    return fits(me, n, count) == OK ? unit_get(me, vr, n, values) : ERROR;
}

EXPORT int fmi3SetFloat64(void *me, const uint32_t *vr, size_t n, const double *values, size_t count) {
    return fits(me, n, count) == OK ? unit_set(me, vr, n, values) : ERROR;
}

#define NONE(name)                                                                                                     \
    EXPORT int name(void *me, const uint32_t *vr, size_t n) {                                                          \
        (void)vr;                                                                                                      \
        return n == 0 ? OK : unit_refuse(me, "%s: all variables of this FMU are of type Float64", #name);            \
    }
#define BOTH(type) NONE(fmi3Get##type) NONE(fmi3Set##type)
BOTH(Float32) BOTH(Int8) BOTH(UInt8) BOTH(Int16) BOTH(UInt16) BOTH(Int32) BOTH(UInt32) BOTH(Int64) BOTH(UInt64)
BOTH(Boolean) BOTH(String) BOTH(Binary) BOTH(Clock)

EXPORT int fmi3GetFMUState(void *me, void **state) { return unit_save(me, state); }
EXPORT int fmi3SetFMUState(void *me, void *state) { return unit_restore(me, state); }

EXPORT int fmi3FreeFMUState(void *me, void **state) {
    (void)me;
    return unit_forget(state);
}

EXPORT int fmi3SerializedFMUStateSize(void *me, void *state, size_t *size) {
    (void)me, (void)state;
    *size = sizeof(Serialized);
    return OK;
}

EXPORT int fmi3SerializeFMUState(void *me, void *state, uint8_t *bytes, size_t size) {
    return unit_serialize(me, state, bytes, size);
}

EXPORT int fmi3DeserializeFMUState(void *me, const uint8_t *bytes, size_t size, void **state) {
    return unit_deserialize(me, bytes, size, state);
}

EXPORT int fmi3DoStep(void *me, double time, double step, bool no_way_back, bool *event, bool *terminate, bool *early,
    double *last) {
    (void)no_way_back;
    *event = *terminate = *early = false;
    int status = unit_step(me, time, step);
    *last = ((Instance *)me)->now.time;
    return status;
}

#define ABSENT(name)                                                                                                   \
    EXPORT int name(void *me) { return unit_refuse(me, "%s: this FMU is for co-simulation without events", #name); }
ABSENT(fmi3EnterEventMode)
ABSENT(fmi3EnterStepMode)
ABSENT(fmi3EnterConfigurationMode)
ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3GetNumberOfVariableDependencies)
ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3GetDirectionalDerivative)
ABSENT(fmi3GetAdjointDerivative)
ABSENT(fmi3GetIntervalDecimal)
ABSENT(fmi3GetIntervalFraction)
ABSENT(fmi3GetShiftDecimal)
ABSENT(fmi3GetShiftFraction)
ABSENT(fmi3SetIntervalDecimal)
ABSENT(fmi3SetIntervalFraction)
ABSENT(fmi3SetShiftDecimal)
ABSENT(fmi3SetShiftFraction)
ABSENT(fmi3EvaluateDiscreteStates)
ABSENT(fmi3UpdateDiscreteStates)
ABSENT(fmi3EnterContinuousTimeMode)
ABSENT(fmi3CompletedIntegratorStep)
ABSENT(fmi3SetTime)
ABSENT(fmi3SetContinuousStates)
ABSENT(fmi3GetContinuousStateDerivatives)
ABSENT(fmi3GetEventIndicators)
ABSENT(fmi3GetContinuousStates)
ABSENT(fmi3GetNominalsOfContinuousStates)
ABSENT(fmi3GetNumberOfEventIndicators)
ABSENT(fmi3GetNumberOfContinuousStates)
ABSENT(fmi3GetOutputDerivatives)
ABSENT(fmi3ActivateModelPartition)
