/* One instance: its variables, its time, and calls of what numba compiled. */
#include "unit.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* An array as numba passes it: owner, parent, elements, their size, address, shape, strides. */
#define ARRAY void *, void *, int64_t, int64_t, void *, int64_t, int64_t
#define ROWS_OF void *, void *, int64_t, int64_t, void *, int64_t, int64_t, int64_t, int64_t
#define ONE(p, n, size) NULL, NULL, (n), (size), (p), (n), (size)
#define TABLE(p, n, m) NULL, NULL, (n) * (m), 8, (p), (n), (m), 8 * (m), 8

extern int32_t model_advance(
    void *result, void *exception, ARRAY, ARRAY, ARRAY, ARRAY, ARRAY, double, double, int64_t, ROWS_OF, ARRAY);
extern int32_t model_start(
    void *result, void *exception, ARRAY, ARRAY, ARRAY, ARRAY, ARRAY, double, ROWS_OF, ARRAY);

#define EVERYTHING(s)                                                                                                  \
    ONE(s->x, STATES, 8), ONE(s->memory, 1, MEMORY_RECORD), ONE(s->inputs, INPUTS, 8),                                 \
        ONE(s->parameters, 1, 8 * PARAMETERS), ONE(s->motion, MOTIONS, 8)
#define ROOM(me) TABLE(me->work, ROWS, STATES), ONE(me->now.out, OUTPUTS, 8)

static int advance(Instance *me, double since, int64_t steps) {
    State *s = &me->now;
    void *result = NULL, *exception = NULL;
    return model_advance(&result, &exception, EVERYTHING(s), since, TICK, steps, ROOM(me));
}

int unit_refuse(Instance *me, const char *format, ...) {
    char text[400];
    va_list given;
    va_start(given, format);
    vsnprintf(text, sizeof text, format, given);
    va_end(given);
    if (me->log != NULL) {
        me->log(me, ERROR, text);
    }
    return ERROR;
}

static int check(Instance *me) {
    State *s = &me->now;
    for (int k = 0; k < STATES; k++) {
        if (!isfinite(s->x[k])) {
            return unit_refuse(me, "there is no finite state at %g s: inputs and parameters do not fit", s->time);
        }
    }
    for (int k = 0; k < ORDERS; k++) {
        double low = s->parameters[ORDER[k].low], high = s->parameters[ORDER[k].high];
        if (low > high) {
            return unit_refuse(me, "%s = %g exceeds %s = %g (SI)", ORDER[k].name, low, ORDER[k].than, high);
        }
    }
    if (model_check(me) != OK) {
        return ERROR;
    }
    for (int k = 0; k < VARIABLES; k++) {
        if (VARIABLE[k].kind == OUTPUT && !isfinite(s->out[VARIABLE[k].place])) {
            return unit_refuse(me, "%s is not finite at %g s: inputs and parameters do not fit", VARIABLE[k].name, s->time);
        }
    }
    return OK;
}

/* At rest with the present inputs and parameters. */
static int start(Instance *me) {
    State *s = &me->now;
    if (s->started) {
        return OK;
    }
    void *result = NULL, *exception = NULL;
    memset(s->x, 0, sizeof s->x);
    memset(s->memory, 0, sizeof s->memory);
    memset(me->work, 0, sizeof me->work);
    memset(s->out, 0, sizeof s->out);
    if (model_start(&result, &exception, EVERYTHING(s), s->air, ROOM(me)) != 0) {
        return unit_refuse(me, "there is no beginning with these inputs and parameters");
    }
    s->ticks = 0;
    s->started = 1;
    return check(me);
}

void unit_reset(Instance *me) {
    State *s = &me->now;
    memset(s, 0, sizeof *s);
    memcpy(s->parameters, DEFAULTS, sizeof s->parameters);
    s->air = 1.0;
    for (int k = 0; k < VARIABLES; k++) {
        if (VARIABLE[k].kind == INPUT) {
            s->inputs[VARIABLE[k].place] = VARIABLE[k].start;
        }
    }
    s->phase = INSTANTIATED;
}

Instance *unit_new(const char *name, const char *token, void *environment, Callback logger, Log log) {
    Instance *me = calloc(1, sizeof *me);
    if (me == NULL) {
        return NULL;
    }
    me->environment = environment;
    me->logger = logger;
    me->log = log;
    size_t length = name == NULL ? 0 : strlen(name);
    me->name = calloc(length + 1, 1);
    if (me->name != NULL && name != NULL) {
        memcpy(me->name, name, length);
    }
    if (me->name == NULL || token == NULL || strcmp(token, TOKEN) != 0) {
        unit_refuse(me, "this FMU is %s, and its model description is that of another", TOKEN);
        unit_free(me);
        return NULL;
    }
    unit_reset(me);
    return me;
}

void unit_free(Instance *me) {
    if (me != NULL) {
        free(me->name);
        free(me);
    }
}

int unit_get(Instance *me, const uint32_t *references, size_t n, double *values) {
    State *s = &me->now;
    for (size_t k = 0; k < n; k++) {
        if (references[k] >= VARIABLES) {
            return unit_refuse(me, "there is no variable with the reference %u", (unsigned)references[k]);
        }
        const Variable *one = &VARIABLE[references[k]];
        if (one->kind == OUTPUT && s->phase < STEPPING && start(me) != OK) {
            return ERROR;
        }
        switch (one->kind) {
        case MOTION: values[k] = s->motion[one->place]; break;
        case INPUT: values[k] = s->inputs[one->place]; break;
        case BEGIN: values[k] = s->air; break;
        case OUTPUT: values[k] = s->out[one->place]; break;
        default: values[k] = s->parameters[one->place];
        }
    }
    return OK;
}

int unit_set(Instance *me, const uint32_t *references, size_t n, const double *values) {
    State *s = &me->now;
    for (size_t k = 0; k < n; k++) { /* nothing is taken over unless all of it fits */
        if (references[k] >= VARIABLES) {
            return unit_refuse(me, "there is no variable with the reference %u", (unsigned)references[k]);
        }
        const Variable *one = &VARIABLE[references[k]];
        if (one->kind == OUTPUT) {
            return unit_refuse(me, "%s is calculated and cannot be set", one->name);
        }
        if ((one->kind == FIXED || one->kind == BEGIN) && s->phase >= STEPPING) {
            return unit_refuse(me, "%s stays as it is once the simulation has begun", one->name);
        }
        if (!isfinite(values[k]) || values[k] < one->low || values[k] > one->high) {
            return unit_refuse(me, "%s = %g %s is outside %g to %g %s", one->name, values[k], one->unit, one->low,
                one->high, one->unit);
        }
        if (one->whole && values[k] != floor(values[k])) {
            return unit_refuse(me, "%s = %g is not one of the whole numbers %g to %g", one->name, values[k], one->low,
                one->high);
        }
    }
    for (size_t k = 0; k < n; k++) {
        const Variable *one = &VARIABLE[references[k]];
        if (one->kind == TUNABLE && s->started) {
            model_changed(s, one->place, values[k]);
        }
        double *to = one->kind == MOTION ? s->motion
            : one->kind == INPUT         ? s->inputs
            : one->kind == BEGIN         ? &s->air
                                         : s->parameters;
        to[one->place] = values[k];
    }
    if (s->phase < STEPPING) {
        s->started = 0;
    }
    return OK;
}

int unit_begin(Instance *me, double time) {
    if (me->now.phase != INSTANTIATED || !isfinite(time)) {
        return unit_refuse(me, "a simulation begins once, at a finite time");
    }
    me->now.begin = me->now.time = time;
    me->now.phase = INITIALIZING;
    return OK;
}

int unit_initialized(Instance *me) {
    if (me->now.phase != INITIALIZING) {
        return unit_refuse(me, "initialization ends where it has begun");
    }
    if (start(me) != OK) {
        return ERROR;
    }
    me->now.phase = STEPPING;
    return OK;
}

int unit_step(Instance *me, double time, double step) {
    State *s = &me->now;
    if (s->phase != STEPPING) {
        return unit_refuse(me, "a step follows initialization");
    }
    if (!isfinite(time) || !isfinite(step) || step < 0.0) {
        return unit_refuse(me, "a step of %g s from %g s is none; a finite length of 0 or more would be right", step, time);
    }
    if (fabs(time - s->time) > 1e-9 * fmax(1.0, fabs(time))) {
        return unit_refuse(me, "a step begins at %.9g s, but the last one ended at %.9g s", time, s->time);
    }
    /* Whole ticks; what is left of one stays for the next step. Times are counted from the start, and do not add up. */
    double ticks = floor((time + step - s->begin) / TICK + 1e-6);
    if (!(ticks < 1e15)) {
        return unit_refuse(me, "a step of %g s is too long", step);
    }
    memcpy(&me->before, s, sizeof *s);
    int64_t more = (int64_t)ticks - s->ticks;
    double since = (double)s->ticks * TICK - (time - s->begin);
    s->time = time + step;
    if (advance(me, since, more > 0 ? more : 0) != 0 || check(me) != OK) {
        memcpy(s, &me->before, sizeof *s);
        return ERROR;
    }
    s->ticks += more > 0 ? more : 0;
    return OK;
}

int unit_end(Instance *me) {
    me->now.phase = ENDED;
    return OK;
}

int unit_save(Instance *me, void **state) {
    if (*state == NULL) {
        *state = malloc(sizeof(State));
    }
    if (*state == NULL) {
        return unit_refuse(me, "there is no memory for a state of %zu bytes", sizeof(State));
    }
    memcpy(*state, &me->now, sizeof(State));
    return OK;
}

int unit_restore(Instance *me, const void *state) {
    if (state == NULL) {
        return unit_refuse(me, "there is no state to go back to");
    }
    memcpy(&me->now, state, sizeof(State));
    return OK;
}

int unit_forget(void **state) {
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return OK;
}

int unit_serialize(Instance *me, const void *state, void *bytes, size_t size) {
    if (state == NULL || size < sizeof(Serialized)) {
        return unit_refuse(me, "a state has %zu bytes; room for %zu is too little", sizeof(Serialized), size);
    }
    memcpy(bytes, TOKEN, sizeof TOKEN);
    memset((char *)bytes + sizeof TOKEN, 0, offsetof(Serialized, state) - sizeof TOKEN);
    memcpy((char *)bytes + offsetof(Serialized, state), state, sizeof(State));
    return OK;
}

int unit_deserialize(Instance *me, const void *bytes, size_t size, void **state) {
    if (size != sizeof(Serialized) || memcmp(bytes, TOKEN, sizeof TOKEN) != 0) {
        return unit_refuse(me, "these %zu bytes are no state of this FMU, which has %zu", size, sizeof(Serialized));
    }
    if (*state == NULL && (*state = malloc(sizeof(State))) == NULL) {
        return unit_refuse(me, "there is no memory for a state");
    }
    memcpy(*state, (const char *)bytes + offsetof(Serialized, state), sizeof(State));
    return OK;
}
