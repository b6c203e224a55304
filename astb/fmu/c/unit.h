/* What both versions of FMI say to one instance, and what each kind of FMU adds to it. */
#ifndef UNIT_H
#define UNIT_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#include "model.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

enum { OK = 0, WARNING = 1, DISCARD = 2, ERROR = 3 };
enum { INSTANTIATED, INITIALIZING, STEPPING, ENDED };

/* All that changes. It is saved and restored as it is. */
typedef struct {
    double x[STATES], inputs[INPUTS], motion[MOTIONS], parameters[PARAMETERS], out[OUTPUTS];
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
    double work[ROWS * STATES];
    Log log;
    void *environment;
    Callback logger;
    char *name;
};

typedef struct {
    char token[sizeof TOKEN];
    State state;
} Serialized;

Instance *unit_new(const char *name, const char *token, void *environment, Callback logger, Log log);
void unit_free(Instance *);
void unit_reset(Instance *);
int unit_refuse(Instance *, const char *format, ...);
int unit_get(Instance *, const uint32_t *references, size_t n, double *values);
int unit_set(Instance *, const uint32_t *references, size_t n, const double *values);
int unit_begin(Instance *, double time);
int unit_initialized(Instance *);
int unit_step(Instance *, double time, double step);
int unit_end(Instance *);
int unit_save(Instance *, void **state);
int unit_restore(Instance *, const void *state);
int unit_forget(void **state);
int unit_serialize(Instance *, const void *state, void *bytes, size_t size);
int unit_deserialize(Instance *, const void *bytes, size_t size, void **state);

/* Of each kind: whether the model holds here, and what else a parameter moves that is changed while it runs. */
int model_check(Instance *);
void model_changed(State *, int place, double value);

#endif
