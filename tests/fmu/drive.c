/* Instances of an FMI 2.0 FMU from birth to death, for valgrind: drive LIBRARY GUID. */
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
    library = argc == 3 ? dlopen(argv[1], RTLD_NOW) : NULL;
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
    unsigned motion[6] = {0, 1, 2, 3, 4, 5};
    double values[6] = {0};
    for (int k = 0; k < 3; k++) {
        void *one = instantiate("spring", 1, argv[2], "", &callbacks, 0, 0);
        if (one == NULL || enter(one) || leave(one)) {
            return 4;
        }
        for (int n = 0; n < 50; n++) {
            values[0] = 1e-4 * n;
            values[2] = -2e-4 * n;
            if (set(one, motion, 6, values) || step(one, 2e-3 * n, 2e-3, 1)) {
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
        values[0] = -0.3;
        if (set(one, motion, 6, values) || step(one, 0.1, 1e-3, 1) != 3) { /* too deep: an error */
            return 8;
        }
        values[0] = 1.0;
        if (set(one, motion, 6, values) != 3) {
            return 9;
        }
        unsigned all[300];
        double numbers[300];
        for (unsigned v = 0; v < 300; v++) {
            all[v] = v;
        }
        if (get(one, all, 300, numbers) || reset(one) || enter(one) || leave(one) || step(one, 0.0, 5e-3, 1)) {
            return 10;
        }
        free(packed);
        forget(one, &state);
        forget(one, &other);
        end(one);
    }
    return dlclose(library);
}
