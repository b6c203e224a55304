/* The same spring with the functions of FMI 3.0, of which co-simulation asks for a few. */
#include <stdbool.h>
#include <stdint.h>

#include "strange.c"

const char *fmi3GetVersion(void) { return "3.0"; }
int fmi3SetDebugLogging(void *me, bool on, size_t n, const char *const names[]) {
    return fmi2SetDebugLogging(me, on, n, names);
}

void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
    bool events, bool early, const uint32_t *between, size_t n, void *environment, void *log, void *update) {
    (void)events, (void)early, (void)between, (void)n, (void)environment, (void)log, (void)update;
    return fmi2Instantiate(name, 1, token, resources, NULL, visible, logging);
}

void fmi3FreeInstance(void *me) { fmi2FreeInstance(me); }
int fmi3EnterInitializationMode(void *me, bool given, double tolerance, double start, bool ends, double stop) {
    return fmi2SetupExperiment(me, given, tolerance, start, ends, stop);
}
int fmi3ExitInitializationMode(void *me) { return fmi2ExitInitializationMode(me); }
int fmi3Terminate(void *me) { return fmi2Terminate(me); }
int fmi3Reset(void *me) { return fmi2Reset(me); }
int fmi3GetFloat64(void *me, const uint32_t *vr, size_t n, double *values, size_t count) {
    return n == count ? fmi2GetReal(me, vr, n, values) : 3;
}
int fmi3SetFloat64(void *me, const uint32_t *vr, size_t n, const double *values, size_t count) {
    return n == count ? fmi2SetReal(me, vr, n, values) : 3;
}
int fmi3DoStep(void *me, double time, double step, bool no_way_back, bool *event, bool *terminate, bool *early,
    double *last) {
    *event = *terminate = *early = false;
    *last = time + step;
    return fmi2DoStep(me, time, step, no_way_back);
}

void *fmi3InstantiateModelExchange(void) { return NULL; }
void *fmi3InstantiateScheduledExecution(void) { return NULL; }
ABSENT(fmi3GetFloat32)
ABSENT(fmi3SetFloat32)
ABSENT(fmi3GetInt8)
ABSENT(fmi3SetInt8)
ABSENT(fmi3GetUInt8)
ABSENT(fmi3SetUInt8)
ABSENT(fmi3GetInt16)
ABSENT(fmi3SetInt16)
ABSENT(fmi3GetUInt16)
ABSENT(fmi3SetUInt16)
ABSENT(fmi3GetInt32)
ABSENT(fmi3SetInt32)
ABSENT(fmi3GetUInt32)
ABSENT(fmi3SetUInt32)
ABSENT(fmi3GetInt64)
ABSENT(fmi3SetInt64)
ABSENT(fmi3GetUInt64)
ABSENT(fmi3SetUInt64)
ABSENT(fmi3GetBoolean)
ABSENT(fmi3SetBoolean)
ABSENT(fmi3GetString)
ABSENT(fmi3SetString)
ABSENT(fmi3GetBinary)
ABSENT(fmi3SetBinary)
ABSENT(fmi3GetClock)
ABSENT(fmi3SetClock)
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
ABSENT(fmi3GetFMUState)
ABSENT(fmi3SetFMUState)
ABSENT(fmi3FreeFMUState)
ABSENT(fmi3SerializedFMUStateSize)
ABSENT(fmi3SerializeFMUState)
ABSENT(fmi3DeserializeFMUState)
