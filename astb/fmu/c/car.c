/* Where the car holds: it has a mass, and a bump stop whose points go on. */
#include "unit.h"

int model_check(Instance *me) {
    const double *p = me->now.parameters, *travel = p + BUMP_STOP_TRAVEL;
    for (int k = 1; k < STOP_POINTS; k++) {
        if (!(travel[k] > travel[k - 1])) {
            return unit_refuse(me, "bump_stop_travel[%d] = %g m does not exceed bump_stop_travel[%d] = %g m", k + 1,
                travel[k], k, travel[k - 1]);
        }
    }
    return OK;
}

void model_changed(State *s, int place, double value) { (void)s, (void)place, (void)value; }
