/* An air spring of nobody's, as an FMU 2.0 for co-simulation: isothermal in a bag with a stack of rubber below it.
 *
 * The stack carries what the bag carries (an algebraic loop, solved by bisection), a plate lands on a stop (an event, to
 * whose instant a step is divided), and a relief valve opens above 8 bar and shuts below 7.5 (a latch). Units are those
 * of its workshop: mm, kN, bar absolute, g/s. What BAD says it does at 2 s is done at 2 s.
 */
#include <math.h>
#include <stddef.h>
#include <stdlib.h>
#include <time.h>

#include "fmi2_rest.h"

enum { TRAVEL, SIDEWAYS, SPEED, AIR, FORCE, SHEAR, BAG, LANDED, AREA, COUNT };

typedef struct {
    double value[COUNT], mass, time;
    int open;
} Spring;

static const double R = 287.0, T = 293.0, STACK = 9e6, STOP = 8e6, GAP = -0.045, PRELOAD = 52e3;

static double bag(const Spring *me, double b) { return me->value[AREA] * 1e-6 * b + 0.055; }

static double carried(const Spring *me, double b) {
    double p = me->mass * R * T / bag(me, b) - 101325.0;
    double rubber = -3e4 * b;
    double stop = b < GAP ? STOP * (GAP - b) : 0.0;
    return p * me->value[AREA] * 1e-6 + rubber + stop;
}

/* b + (PRELOAD - F(b)) / STACK = z: F falls with b, so that the left side rises. */
static double solve(const Spring *me, double z) {
    double low = -0.15, high = 0.3;
    for (int k = 0; k < 60; k++) {
        double b = 0.5 * (low + high);
        if (b + (PRELOAD - carried(me, b)) / STACK < z) {
            low = b;
        } else {
            high = b;
        }
    }
    return 0.5 * (low + high);
}

static void outputs(Spring *me) {
    double *v = me->value;
    double b = solve(me, 1e-3 * v[TRAVEL]);
    v[FORCE] = 1e-3 * (carried(me, b) - 6e3 * 1e-3 * v[SPEED]);
    v[BAG] = 1e-5 * me->mass * R * T / bag(me, b);
    v[SHEAR] = 1e-3 * (-150e3 - 1.1 * 1e5 * (v[BAG] - 1.01325) * 0.26) * 1e-3 * v[SIDEWAYS];
    v[LANDED] = b < GAP;
}

static void go_on(Spring *me, double h) {
    double *v = me->value;
    if (v[BAG] > 8.0) {
        me->open = 1;
    } else if (v[BAG] < 7.5) {
        me->open = 0;
    }
    me->mass += h * (1e-3 * v[AIR] - (me->open ? 0.02 : 0.0));
    double least = 0.9 * 101325.0 * 0.04 / (R * T);
    me->mass = me->mass < least ? least : me->mass;
    outputs(me);
}

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
    int visible, int logging) {
    (void)name, (void)type, (void)guid, (void)resources, (void)callbacks, (void)visible, (void)logging;
    Spring *me = calloc(1, sizeof *me);
    me->value[AREA] = 0.26e6;
    return me;
}

int fmi2SetupExperiment(void *me, int given, double tolerance, double start, int ends, double stop) {
    (void)given, (void)tolerance, (void)ends, (void)stop;
    ((Spring *)me)->time = start;
    return 0;
}
int fmi2EnterInitializationMode(void *me) { return me == NULL; }

int fmi2ExitInitializationMode(void *one) {
    Spring *me = one;
    double low = 0.0, high = 1.0; /* no air but that of the atmosphere, where the plate is */
    for (int k = 0; k < 60; k++) {
        me->mass = 0.5 * (low + high);
        outputs(me);
        if (me->value[BAG] < 1.01325) {
            low = me->mass;
        } else {
            high = me->mass;
        }
    }
    return 0;
}

int fmi2GetReal(void *me, const unsigned *vr, size_t n, double *values) {
    for (size_t k = 0; k < n; k++) {
        values[k] = ((Spring *)me)->value[vr[k]];
    }
    return 0;
}

int fmi2SetReal(void *one, const unsigned *vr, size_t n, const double *values) {
    Spring *me = one;
    for (size_t k = 0; k < n; k++) {
        me->value[vr[k]] = values[k];
    }
    if (me->mass > 0.0) {
        outputs(me); /* they follow their inputs at once */
    }
    return 0;
}

int fmi2DoStep(void *one, double time, double step, int no_way_back) {
    (void)no_way_back;
    Spring *me = one;
    me->time = time + step;
#ifdef BAD
    if (BAD == 5) { /* slow from the start */
        const struct timespec nap = {0, 2500000};
        nanosleep(&nap, NULL);
    }
    if (me->time > 2.0) {
        if (BAD == 1) {
            return 3;
        } else if (BAD == 2) {
            me->value[FORCE] = NAN;
            me->mass = NAN;
            return 0;
        } else if (BAD == 3) {
            *(volatile int *)0 = 1;
        } else if (BAD == 4) {
            for (volatile int forever = 1; forever;) {
            }
        }
    }
#endif
    int landed = me->value[LANDED] != 0.0;
    double before = me->mass;
    go_on(me, step);
    if ((me->value[LANDED] != 0.0) != landed) { /* find the instant, and take the step in two parts */
        double low = 0.0, high = step;
        for (int k = 0; k < 30; k++) {
            me->mass = before;
            go_on(me, 0.5 * (low + high));
            if ((me->value[LANDED] != 0.0) != landed) {
                high = 0.5 * (low + high);
            } else {
                low = 0.5 * (low + high);
            }
        }
        go_on(me, step - high);
    }
    return 0;
}
