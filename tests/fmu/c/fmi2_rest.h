/* The functions of FMI 2.0 that an FMU of the tests needs and that do nothing of its own. */
#include <stddef.h>
#include <stdlib.h>

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

void fmi2FreeInstance(void *me) { free(me); }
int fmi2SetDebugLogging(void *me, int on, size_t n, const char *const names[]) {
    (void)me, (void)on, (void)n, (void)names;
    return 0;
}
int fmi2Terminate(void *me) { return me == NULL; }
int fmi2Reset(void *me) { return me == NULL; }

#define NONE(name, type)                                                                                               \
    int name(void *me, const unsigned *vr, size_t n, type values) {                                                    \
        (void)me, (void)vr, (void)values;                                                                              \
        return n == 0 ? 0 : 3;                                                                                         \
    }
NONE(fmi2GetInteger, int *)
NONE(fmi2GetBoolean, int *)
NONE(fmi2GetString, const char **)
NONE(fmi2SetInteger, const int *)
NONE(fmi2SetBoolean, const int *)
NONE(fmi2SetString, const char *const *)

#define ABSENT(name)                                                                                                   \
    int name(void) { return 3; }
ABSENT(fmi2GetFMUstate)
ABSENT(fmi2SetFMUstate)
ABSENT(fmi2FreeFMUstate)
ABSENT(fmi2SerializedFMUstateSize)
ABSENT(fmi2SerializeFMUstate)
ABSENT(fmi2DeSerializeFMUstate)
ABSENT(fmi2GetDirectionalDerivative)
ABSENT(fmi2SetRealInputDerivatives)
ABSENT(fmi2GetRealOutputDerivatives)
ABSENT(fmi2CancelStep)
ABSENT(fmi2GetStatus)
ABSENT(fmi2GetRealStatus)
ABSENT(fmi2GetIntegerStatus)
ABSENT(fmi2GetBooleanStatus)
ABSENT(fmi2GetStringStatus)
