/* Magic-Formula tyres; the equations are in documentation/index.html, the law is the one of plant_models/tyres/formula.py.
 *
 * Signs after ISO 8855: x forward, y left. A positive slip angle makes a force to the left.
 */
#include "tyre.h"
#include "car.h"

static const double RESERVE = 0.9;             /* braking and driving take no more than this part of the peak */
static const double STANDSTILL_SPEED = 1.0;    /* carcass damping fades out until this speed [m/s] */
static const double STANDSTILL_DAMPING = 0.05; /* [s] */
static const double SLIDING_SPEED = 60.0;      /* keeps the rate of slip below (V + this) / sigma [m/s] */

typedef struct {
    double force, lift, peak, steepness; /* steepness = cornering stiffness / peak */
} Lateral;

/* The guard is the one of plant_models/tyres/formula.py. */
static double peak(double at_nominal, double change, double load, double dfz, const double v[]) {
    return larger(at_nominal + change * dfz, 0.1) * load * v[FRICTION];
}

static double cornering_stiffness(double load, const double v[]) {
    if (v[TYRE_P_KY2] <= 0.0) return v[TYRE_P_KY1] * load;
    double t = load / (v[TYRE_P_KY2] * v[TYRE_NOMINAL_LOAD]), factor = v[TYRE_P_KY1] * v[TYRE_NOMINAL_LOAD];
    if (v[TYRE_P_KY4] == 2.0) return factor * 2.0 * t / (1.0 + t * t); /* = sin(2 atan(t)) */
    return factor * sin(v[TYRE_P_KY4] * atan(t));
}

/* Magic Formula, pure lateral slip. */
static Lateral lateral(double slip_angle, double load, double side, double scale, const double v[]) {
    Lateral tyre = {0.0, 0.0, 0.0, 0.0};
    if (load <= 0.0 || v[FRICTION] <= 0.0) return tyre;
    double dfz = load / v[TYRE_NOMINAL_LOAD] - 1.0;
    double slip = slip_angle + side * v[FRICTION] * (v[TYRE_P_HY1] + v[TYRE_P_HY2] * dfz);
    double turn = slip > 0.0 ? side : slip < 0.0 ? -side : 0.0;
    double curvature = (v[TYRE_P_EY1] + v[TYRE_P_EY2] * dfz) * (1.0 - v[TYRE_P_EY3] * turn);
    tyre.peak = peak(v[TYRE_P_DY1], v[TYRE_P_DY2], load, dfz, v);
    tyre.steepness = scale * cornering_stiffness(load, v) / tyre.peak;
    tyre.lift = side * v[FRICTION] * load * (v[TYRE_P_VY1] + v[TYRE_P_VY2] * dfz);
    double x = tyre.steepness / v[TYRE_P_CY1] * slip;
    if (curvature > 1.0) curvature = 1.0;
    tyre.force = tyre.peak * sin(v[TYRE_P_CY1] * atan(x - curvature * (x - atan(x)))) + tyre.lift;
    return tyre;
}

Wheel wheel(double u, double w, double slip, double load, double demand, double side, double scale, const double v[]) {
    Wheel a = {asin(clip(slip, -1.0, 1.0)), 0.0, 0.0, 0.0};
    double speed = sqrt(u * u + w * w), sigma = v[TYRE_RELAXATION_Y];
    load = larger(load, 0.0);
    double peak_x = peak(v[TYRE_P_DX1], v[TYRE_P_DX2], load, load / v[TYRE_NOMINAL_LOAD] - 1.0, v);
    double fading = speed < STANDSTILL_SPEED ? 1.0 - speed / STANDSTILL_SPEED : 0.0;
    Lateral tyre = lateral(a.slip_angle, load, side, scale, v);
    double damping = STANDSTILL_DAMPING * fading * fading * tyre.steepness * tyre.peak / sigma;
    double used = peak_x > 0.0 ? clip(demand / peak_x, -RESERVE, RESERVE) : 0.0;
    double force_y = clip(tyre.force - damping * w, tyre.lift - tyre.peak, tyre.lift + tyre.peak);
    a.force_x = used * peak_x;
    a.force_y = force_y * sqrt(1.0 - used * used);
    double q = tyre.steepness * slip * tyre.steepness * slip; /* > 1: sliding, where the relaxation length shrinks */
    a.slip_rate = (1.0 + q / (1.0 + q * speed / SLIDING_SPEED)) * (-w - speed * slip) / sigma;
    return a;
}

double settled_slip(double u, double w) {
    double speed = sqrt(u * u + w * w);
    return speed > HOLD_SPEED ? -w / speed : 0.0;
}

double asked_of_tyres(const double v[], double speed) {
    double grip = RESERVE * v[TYRE_P_DX1] * v[FRICTION] * GRAVITY;
    return clip(asked_acceleration(v, speed), -grip, grip);
}

double front_load(const double v[], double a_x) {
    double weight = v[MASS] * GRAVITY;
    return clip((weight * v[L_R] - v[MASS] * a_x * v[CG_HEIGHT]) / (v[L_F] + v[L_R]), 0.0, weight);
}

int has_sides(const double v[]) {
    return v[TYRE_P_HY1] != 0.0 || v[TYRE_P_HY2] != 0.0 || v[TYRE_P_VY1] != 0.0 || v[TYRE_P_VY2] != 0.0 ||
           v[TYRE_P_EY3] != 0.0;
}
