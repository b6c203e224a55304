/* A trajectory of an FMU of either version, on Linux and on Windows:

   steps LIBRARY TOKEN STEP GIVEN FOUND REFUSED INPUTS OUTPUT...

   GIVEN and FOUND are files of doubles: a row of INPUTS (references 0, 1, ...) before each step, and a row of the
   OUTPUTs (references) after it. Setting the output REFUSED must be refused; the message is printed. */
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

#ifdef _WIN32
#include <windows.h>
static HMODULE library;
#define OPEN(path) LoadLibraryA(path)
#define FIND(name) ((Function)(void *)GetProcAddress(library, name))
#else
#include <dlfcn.h>
static void *library;
#define OPEN(path) dlopen(path, RTLD_NOW)
#define FIND(name) ((Function)dlsym(library, name))
#endif

enum { SOME = 200 }; /* more variables than an FMU moves or shows */

typedef void (*Function)(void);

typedef struct {
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

static void say2(void *e, const char *name, int status, const char *category, const char *message, ...) {
    (void)e;
    printf("%s %d %s %s\n", name, status, category, message);
}

static void say3(void *e, int status, const char *category, const char *message) {
    printf("%s %d %s %s\n", (const char *)e, status, category, message);
}

static Callbacks callbacks = {say2, calloc, free, NULL, NULL};
static bool three;

static void *begin(const char *token) {
    void *one;
    if (three) {
        one = ((void *(*)(const char *, const char *, const char *, bool, bool, bool, bool, const uint32_t *, size_t,
            void *, Function, Function))FIND("fmi3InstantiateCoSimulation"))(
            "one", token, "", false, false, false, false, NULL, 0, "one", (Function)say3, NULL);
        if (one == NULL || ((int (*)(void *, bool, double, double, bool, double))FIND("fmi3EnterInitializationMode"))(
                               one, false, 0.0, 0.0, false, 0.0)) {
            return NULL;
        }
        return ((int (*)(void *))FIND("fmi3ExitInitializationMode"))(one) ? NULL : one;
    }
    one = ((void *(*)(const char *, int, const char *, const char *, const Callbacks *, int, int))FIND(
        "fmi2Instantiate"))("one", 1, token, "", &callbacks, 0, 0);
    if (one == NULL || ((int (*)(void *, int, double, double, int, double))FIND("fmi2SetupExperiment"))(
                           one, 0, 0.0, 0.0, 0, 0.0)) {
        return NULL;
    }
    return ((int (*)(void *))FIND("fmi2EnterInitializationMode"))(one) ||
            ((int (*)(void *))FIND("fmi2ExitInitializationMode"))(one)
        ? NULL
        : one;
}

/* FMI 2.0 has no count of values; the callers of both systems remove arguments, so one more does no harm. */
typedef int (*Access)(void *, const uint32_t *, size_t, double *, size_t);

static int step(void *one, double time, double length) {
    bool event, terminate, early;
    double last;
    return three
        ? ((int (*)(void *, double, double, bool, bool *, bool *, bool *, double *))FIND("fmi3DoStep"))(
              one, time, length, true, &event, &terminate, &early, &last)
        : ((int (*)(void *, double, double, int))FIND("fmi2DoStep"))(one, time, length, 1);
}

int main(int argc, char **argv) {
    if (argc < 9 || (library = OPEN(argv[1])) == NULL) {
        return 2;
    }
    three = FIND("fmi3GetVersion") != NULL;
    Access set = (Access)FIND(three ? "fmi3SetFloat64" : "fmi2SetReal");
    Access get = (Access)FIND(three ? "fmi3GetFloat64" : "fmi2GetReal");
    double length = atof(argv[3]), in[SOME], out[SOME];
    uint32_t inputs = (uint32_t)atoi(argv[7]), outputs = (uint32_t)argc - 8, to[SOME], from[SOME];
    uint32_t refused = (uint32_t)atoi(argv[6]);
    FILE *given = fopen(argv[4], "rb"), *found = fopen(argv[5], "wb");
    void *one = begin(argv[2]);
    if (given == NULL || found == NULL || one == NULL || inputs > SOME || outputs > SOME) {
        return 3;
    }
    for (uint32_t k = 0; k < SOME; k++) {
        to[k] = k;
        from[k] = k < outputs ? (uint32_t)atoi(argv[8 + k]) : 0;
    }
    for (int n = 0; fread(in, sizeof *in, inputs, given) == inputs; n++) {
        if (set(one, to, inputs, in, inputs) || step(one, n * length, length) || get(one, from, outputs, out, outputs)) {
            return 4;
        }
        fwrite(out, sizeof *out, outputs, found);
    }
    in[0] = 1e6;
    if (set(one, &refused, 1, in, 1) != 3) {
        return 5;
    }
    ((void (*)(void *))FIND(three ? "fmi3FreeInstance" : "fmi2FreeInstance"))(one);
    return fclose(found);
}
