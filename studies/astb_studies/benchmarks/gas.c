/* Two chambers joined by an orifice, both warmed by their walls; a sine moves the volume of the first.
 *
 * The equations of bench_sim.model.orifice and bench_sim.model.gas, written down once more as plain C, with the
 * classical Runge-Kutta step. State: mass and internal energy, x = (m_b, m_a, U_b, U_a).
 */
#include <math.h>

typedef struct {
    double R, kappa, laminar, area;               /* gas; width of the laminar zone; C_d A of the orifice */
    double heat_b, heat_a, wall_b, wall_a;        /* hS in W/K at the reference density; walls in K */
    double density, exponent;                     /* reference density and exponent of hS */
    double V_b, A, V_a;                           /* volume of the bellows at rest, its slope, auxiliary volume */
    double amplitude, omega;
} Gas;

static double nozzle_function(double r, double kappa)
{
    double q = pow(r, 1.0 / kappa);
    if (q > 0.5 * (kappa + 1.0) * r) {
        q = pow(2.0 / (kappa + 1.0), 1.0 / (kappa - 1.0));
        r = 2.0 * q / (kappa + 1.0);
    }
    return sqrt(2.0 * kappa / (kappa - 1.0) * fmax(q * (q - r), 0.0));
}

static double nozzle_flow(double p_up, double T_up, double p_down, const Gas *g)
{
    double r = p_down / p_up;
    double psi = r > g->laminar ? nozzle_function(g->laminar, g->kappa) * (1.0 - r) / (1.0 - g->laminar)
                                : nozzle_function(r, g->kappa);
    return g->area * p_up / sqrt(g->R * T_up) * psi;
}

static void slope(double t, const double *x, const Gas *g, double *dx)
{
    double gamma = g->kappa - 1.0;
    double V = g->V_b + g->A * g->amplitude * sin(g->omega * t);
    double V_rate = g->A * g->amplitude * g->omega * cos(g->omega * t);
    double p_b = gamma * x[2] / V, p_a = gamma * x[3] / g->V_a;
    double T_b = gamma * x[2] / (x[0] * g->R), T_a = gamma * x[3] / (x[1] * g->R);
    double flow = p_b >= p_a ? nozzle_flow(p_b, T_b, p_a, g) : -nozzle_flow(p_a, T_a, p_b, g);
    double power = flow * g->kappa / gamma * g->R * (flow > 0.0 ? T_b : T_a);
    dx[0] = -flow;
    dx[1] = flow;
    dx[2] = -power - p_b * V_rate + g->heat_b * pow(x[0] / V / g->density, g->exponent) * (g->wall_b - T_b);
    dx[3] = power + g->heat_a * pow(x[1] / g->V_a / g->density, g->exponent) * (g->wall_a - T_a);
}

void run(double *x, const Gas *g, double dt, long steps)
{
    double k1[4], k2[4], k3[4], k4[4], y[4];
    for (long n = 0; n < steps; n++) {
        double t = n * dt;
        slope(t, x, g, k1);
        for (int k = 0; k < 4; k++) y[k] = x[k] + 0.5 * dt * k1[k];
        slope(t + 0.5 * dt, y, g, k2);
        for (int k = 0; k < 4; k++) y[k] = x[k] + 0.5 * dt * k2[k];
        slope(t + 0.5 * dt, y, g, k3);
        for (int k = 0; k < 4; k++) y[k] = x[k] + dt * k3[k];
        slope(t + dt, y, g, k4);
        for (int k = 0; k < 4; k++) x[k] += dt / 6.0 * (k1[k] + 2.0 * (k2[k] + k3[k]) + k4[k]);
    }
}
