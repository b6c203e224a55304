/* Where air springs hold: the membrane has a length, and no chamber is near a vacuum. */
#include <math.h>

#include "unit.h"

int model_check(Instance *me) {
    State *s = &me->now;
    double air = s->parameters[ATMOSPHERE];
    for (int side = 0; side < 2; side++) {
        const char *name = side == 0 ? "left" : "right";
        double height = s->out[BELLOWS_VERTICAL + side], pressure = s->out[PRESSURE + side];
        double length = s->parameters[MEMBRANE + side], slope = s->parameters[MEMBRANE_SLOPE + side];
        if (!(length + slope * height > 0.0)) {
            return unit_refuse(me, "the %s bellows is at %.1f mm; the model holds above %.1f mm", name, 1e3 * height,
                -1e3 * length / slope);
        }
        if (!(pressure >= 0.5 * air && s->out[AUXILIARY_PRESSURE + side] >= 0.5 * air)) {
            return unit_refuse(me, "the %s bellows is at %.3f bar absolute; the model holds above %.3f bar", name,
                1e-5 * pressure, 0.5e-5 * air);
        }
        double pipe = s->parameters[PIPE_LENGTH + side], bore = s->parameters[PIPE_DIAMETER + side];
        if (pipe > 0.0 && pipe < bore) {
            return unit_refuse(me, "pipe_length = %g m is less than pipe_diameter = %g m; 0 m means no pipe", pipe, bore);
        }
    }
    return OK;
}

void model_changed(State *s, int place, double value) {
    int side = place - PRELOAD;
    if (SHIMS && (side == 0 || side == 1) && s->parameters[EMERGENCY] != 0.0) {
        /* Shims: they lift what stands on the spring, and with it the lever of its valve. */
        s->x[LEVER + side] += (value - s->parameters[place]) / s->parameters[EMERGENCY_STIFFNESS + side];
    }
}
