/* Two tanks in a row whose outflow is proportional to their level, as an FMU 2.0 for co-simulation.
 *
 * Its steps are exact for a flow that is held. Units are l/s, m, l/(s.m) and m2.
 */
#include <math.h>

#include "fmi2_rest.h"

enum { FLOW, UPPER, LOWER, UPPER_HOLE, LOWER_HOLE, UPPER_AREA, LOWER_AREA, UPPER_START, LOWER_START, COUNT };

typedef struct {
    double value[COUNT];
} Tanks;

void *fmi2Instantiate(const char *name, int type, const char *guid, const char *resources, const void *callbacks,
    int visible, int logging) {
    (void)name, (void)type, (void)guid, (void)resources, (void)callbacks, (void)visible, (void)logging;
    Tanks *me = calloc(1, sizeof *me);
    const double usual[COUNT] = {0.0, 0.0, 0.0, 2.0, 3.0, 0.05, 0.09, 0.2, 0.1};
    for (int k = 0; k < COUNT; k++) {
        me->value[k] = usual[k];
    }
    return me;
}

int fmi2SetupExperiment(void *me, int given, double tolerance, double start, int ends, double stop) {
    (void)given, (void)tolerance, (void)start, (void)ends, (void)stop;
    return me == NULL;
}
int fmi2EnterInitializationMode(void *me) { return me == NULL; }
int fmi2ExitInitializationMode(void *one) {
    double *v = ((Tanks *)one)->value;
    v[UPPER] = v[UPPER_START];
    v[LOWER] = v[LOWER_START];
    return 0;
}

int fmi2GetReal(void *me, const unsigned *vr, size_t n, double *values) {
    for (size_t k = 0; k < n; k++) {
        values[k] = ((Tanks *)me)->value[vr[k]];
    }
    return 0;
}

int fmi2SetReal(void *me, const unsigned *vr, size_t n, const double *values) {
    for (size_t k = 0; k < n; k++) {
        ((Tanks *)me)->value[vr[k]] = values[k];
    }
    return 0;
}

int fmi2DoStep(void *one, double time, double h, int no_way_back) {
    (void)time, (void)no_way_back;
    double *v = ((Tanks *)one)->value;
    double a = 1e-3 * v[UPPER_HOLE] / v[UPPER_AREA], b = 1e-3 * v[LOWER_HOLE] / v[LOWER_AREA];
    double settled = v[FLOW] / v[UPPER_HOLE], away = v[UPPER] - settled;
    double down = 1e-3 * v[UPPER_HOLE] / v[LOWER_AREA];
    v[LOWER] = v[LOWER] * exp(-b * h) + down * (settled * (1.0 - exp(-b * h)) / b +
                                                   away * (exp(-a * h) - exp(-b * h)) / (b - a));
    v[UPPER] = settled + away * exp(-a * h);
    return 0;
}
