/* The functions of FMI 2.0 for co-simulation. */
#include "unit.h"

typedef void (*Logger)(void *, const char *, int, const char *, const char *, ...);

typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

static void say(Instance *me, int status, const char *message) {
    Logger logger = (Logger)me->logger;
    if (logger != NULL) {
        logger(me->environment, me->name == NULL ? "" : me->name, status, "logStatusError", message);
    }
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT int fmi2SetDebugLogging(void *me, int on, size_t n, const char *const categories[]) {
    (void)me, (void)on, (void)n, (void)categories;
    return OK; /* errors are always told, and there is nothing else */
}

EXPORT void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources,
    const Callbacks *callbacks, int visible, int logging) {
    (void)resources, (void)visible, (void)logging;
    if (type != 1 || callbacks == NULL) { /* co-simulation */
        return NULL;
    }
    return unit_new(name, guid, callbacks->environment, (Callback)callbacks->logger, say);
}

EXPORT void fmi2FreeInstance(void *me) { unit_free(me); }

EXPORT int fmi2SetupExperiment(void *me, int given, double tolerance, double begin, int ends, double stop) {
    (void)given, (void)tolerance, (void)ends, (void)stop;
    ((Instance *)me)->now.begin = begin;
    return OK;
}

EXPORT int fmi2EnterInitializationMode(void *me) { return unit_begin(me, ((Instance *)me)->now.begin); }
EXPORT int fmi2ExitInitializationMode(void *me) { return unit_initialized(me); }
EXPORT int fmi2Terminate(void *me) { return unit_end(me); }

EXPORT int fmi2Reset(void *me) {
    unit_reset(me);
    return OK;
}

EXPORT int fmi2GetReal(void *me, const unsigned *vr, size_t n, double *values) { return unit_get(me, vr, n, values); }
EXPORT int fmi2SetReal(void *me, const unsigned *vr, size_t n, const double *values) {
    return unit_set(me, vr, n, values);
}

#define NONE(name, type)                                                                                               \
    EXPORT int name(void *me, const unsigned *vr, size_t n, type values) {                                             \
        (void)vr, (void)values;                                                                                        \
        return n == 0 ? OK : unit_refuse(me, "%s: all variables of this FMU are real numbers", #name);               \
    }
NONE(fmi2GetInteger, int *)
NONE(fmi2GetBoolean, int *)
NONE(fmi2GetString, const char **)
NONE(fmi2SetInteger, const int *)
NONE(fmi2SetBoolean, const int *)
NONE(fmi2SetString, const char *const *)

EXPORT int fmi2GetFMUstate(void *me, void **state) { return unit_save(me, state); }
EXPORT int fmi2SetFMUstate(void *me, void *state) { return unit_restore(me, state); }

EXPORT int fmi2FreeFMUstate(void *me, void **state) {
    (void)me;
    return unit_forget(state);
}

EXPORT int fmi2SerializedFMUstateSize(void *me, void *state, size_t *size) {
    (void)me, (void)state;
    *size = sizeof(Serialized);
    return OK;
}

EXPORT int fmi2SerializeFMUstate(void *me, void *state, char *bytes, size_t size) {
    return unit_serialize(me, state, bytes, size);
}

EXPORT int fmi2DeSerializeFMUstate(void *me, const char *bytes, size_t size, void **state) {
    return unit_deserialize(me, bytes, size, state);
}

EXPORT int fmi2GetDirectionalDerivative(
    void *me, const unsigned *of, size_t n, const unsigned *by, size_t m, const double *seed, double *values) {
    (void)of, (void)n, (void)by, (void)m, (void)seed, (void)values;
    return unit_refuse(me, "this FMU has no directional derivatives");
}

EXPORT int fmi2SetRealInputDerivatives(
    void *me, const unsigned *vr, size_t n, const int *order, const double *values) {
    (void)vr, (void)order, (void)values;
    return n == 0 ? OK : unit_refuse(me, "the speeds are inputs of their own: derivatives of inputs are not taken");
}

EXPORT int fmi2GetRealOutputDerivatives(void *me, const unsigned *vr, size_t n, const int *order, double *values) {
    (void)vr, (void)order, (void)values;
    return n == 0 ? OK : unit_refuse(me, "this FMU has no derivatives of its outputs");
}

EXPORT int fmi2DoStep(void *me, double time, double step, int no_way_back) {
    (void)no_way_back;
    return unit_step(me, time, step);
}

EXPORT int fmi2CancelStep(void *me) { return unit_refuse(me, "no step lasts until it could be cancelled"); }

EXPORT int fmi2GetRealStatus(void *me, int kind, double *value) {
    if (kind != 2) { /* fmi2LastSuccessfulTime */
        return DISCARD;
    }
    *value = ((Instance *)me)->now.time;
    return OK;
}

#define NO_STATUS(name, type)                                                                                          \
    EXPORT int name(void *me, int kind, type *value) {                                                                 \
        (void)me, (void)kind, (void)value;                                                                             \
        return DISCARD;                                                                                                \
    }
NO_STATUS(fmi2GetStatus, int)
NO_STATUS(fmi2GetIntegerStatus, int)
NO_STATUS(fmi2GetBooleanStatus, int)
NO_STATUS(fmi2GetStringStatus, const char *)
