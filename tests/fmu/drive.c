/* Instances of an FMI 2.0 FMU from birth to death, for valgrind:

   drive LIBRARY GUID VARIABLES MOVED BY OUTSIDE VALUE STOPPING VALUE

   MOVED goes on by so much a step, OUTSIDE is not taken at its value, and with STOPPING at its value no step is. */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct {
    void (*log)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

static int told;
static void log_message(void *e, const char *name, int status, const char *category, const char *message, ...) {
    (void)e, (void)name, (void)status, (void)category;
    told += message != NULL;
}

static void *library;
static void *find(const char *name) {
    void *found = dlsym(library, name);
    if (found == NULL) {
        fprintf(stderr, "%s\n", dlerror());
        exit(2);
    }
    return found;
}

int main(int argc, char **argv) {
    library = argc == 10 ? dlopen(argv[1], RTLD_NOW) : NULL;
    if (library == NULL) {
        return 2;
    }
    Callbacks callbacks = {log_message, calloc, free, NULL, NULL};
    void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int);
    int (*enter)(void *), (*leave)(void *), (*reset)(void *), (*step)(void *, double, double, int);
    int (*set)(void *, const unsigned *, size_t, const double *), (*get)(void *, const unsigned *, size_t, double *);
    int (*save)(void *, void **), (*restore)(void *, void *), (*forget)(void *, void **);
    int (*size)(void *, void *, size_t *), (*pack)(void *, void *, char *, size_t);
    int (*unpack)(void *, const char *, size_t, void **);
    void (*end)(void *);
    *(void **)&instantiate = find("fmi2Instantiate");
    *(void **)&enter = find("fmi2EnterInitializationMode");
    *(void **)&leave = find("fmi2ExitInitializationMode");
    *(void **)&reset = find("fmi2Reset");
    *(void **)&step = find("fmi2DoStep");
    *(void **)&set = find("fmi2SetReal");
    *(void **)&get = find("fmi2GetReal");
    *(void **)&save = find("fmi2GetFMUstate");
    *(void **)&restore = find("fmi2SetFMUstate");
    *(void **)&forget = find("fmi2FreeFMUstate");
    *(void **)&size = find("fmi2SerializedFMUstateSize");
    *(void **)&pack = find("fmi2SerializeFMUstate");
    *(void **)&unpack = find("fmi2DeSerializeFMUstate");
    *(void **)&end = find("fmi2FreeInstance");
    if (instantiate("stranger", 1, "{another}", "", &callbacks, 0, 0) != NULL || told != 1) {
        return 3;
    }
    unsigned variables = (unsigned)atoi(argv[3]), moved = (unsigned)atoi(argv[4]);
    unsigned outside = (unsigned)atoi(argv[6]), stopping = (unsigned)atoi(argv[8]);
    double by = atof(argv[5]), beyond = atof(argv[7]), stop = atof(argv[9]);
    for (int k = 0; k < 3; k++) {
        void *one = instantiate("spring", 1, argv[2], "", &callbacks, 0, 0);
        if (one == NULL || enter(one) || leave(one)) {
            return 4;
        }
        for (int n = 0; n < 50; n++) {
            double value = by * n;
            if (set(one, &moved, 1, &value) || step(one, 2e-3 * n, 2e-3, 1)) {
                return 5;
            }
        }
        void *state = NULL, *other = NULL;
        size_t bytes = 0;
        if (save(one, &state) || size(one, state, &bytes)) {
            return 6;
        }
        char *packed = malloc(bytes);
        if (pack(one, state, packed, bytes) || unpack(one, packed, bytes, &other) || restore(one, other)) {
            return 7;
        }
        if (set(one, &stopping, 1, &stop) || step(one, 0.1, 1e-3, 1) != 3) { /* an error */
            return 8;
        }
        if (set(one, &outside, 1, &beyond) != 3) {
            return 9;
        }
        unsigned *all = calloc(variables, sizeof *all);
        double *numbers = calloc(variables, sizeof *numbers);
        for (unsigned v = 0; v < variables; v++) {
            all[v] = v;
        }
        if (get(one, all, variables, numbers) || reset(one) || enter(one) || leave(one) || step(one, 0.0, 5e-3, 1)) {
            return 10;
        }
        free(packed);
        free(all);
        free(numbers);
        forget(one, &state);
        forget(one, &other);
        end(one);
    }
    return dlclose(library);
}
