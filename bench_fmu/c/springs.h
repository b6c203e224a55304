/* What both versions of FMI say to one instance of the springs. */
#ifndef SPRINGS_H
#define SPRINGS_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "model.h"

#define EXPORT __attribute__((visibility("default")))

enum { OK = 0, WARNING = 1, DISCARD = 2, ERROR = 3 };
enum { INSTANTIATED, INITIALIZING, STEPPING, ENDED };

/* All that changes. It is saved and restored as it is. */
typedef struct {
    double x[STATES], inputs[INPUTS], motion[MOTIONS], parameters[PARAMETERS], out[ALGEBRAICS];
    double memory[MEMORY_DOUBLES];
    double air; /* at the start: the share of the pressure that carries the preload */
    double begin, time; /* of the simulation: its start, and the end of the last communication step */
    int64_t ticks;      /* so many have been done since the start */
    int64_t phase;
    int64_t started; /* whether x, memory and out are those of the inputs and parameters at the start */
} State;

typedef struct Instance Instance;
typedef void (*Log)(Instance *, int status, const char *message);
/* A function of the environment: that which logs takes other arguments in each version of FMI. */
typedef void (*Callback)(void);

struct Instance {
    State now, before;
    double work[5 * STATES];
    Log log;
    void *environment;
    Callback logger;
    char *name;
};

typedef struct {
    char token[sizeof TOKEN];
    State state;
} Serialized;

Instance *spring_new(const char *name, const char *token, void *environment, Callback logger, Log log);
void spring_free(Instance *);
void spring_reset(Instance *);
int spring_refuse(Instance *, const char *format, ...);
int spring_get(Instance *, const uint32_t *references, size_t n, double *values);
int spring_set(Instance *, const uint32_t *references, size_t n, const double *values);
int spring_begin(Instance *, double time);
int spring_initialized(Instance *);
int spring_step(Instance *, double time, double step);
int spring_end(Instance *);
int spring_save(Instance *, void **state);
int spring_restore(Instance *, const void *state);
int spring_forget(void **state);
int spring_serialize(Instance *, const void *state, void *bytes, size_t size);
int spring_deserialize(Instance *, const void *bytes, size_t size, void **state);

#endif
