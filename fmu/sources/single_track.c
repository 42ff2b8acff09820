/* Nonlinear single-track car; the equations are in documentation/index.html.
 *
 * Signs after ISO 8855: x forward, y left. A positive slip angle makes a force to the left.
 */
#include "car.h"

static const double TYRE_RESERVE = 0.9;       /* braking and driving take no more than this part of the peak */
static const double STANDSTILL_SPEED = 1.0;   /* carcass damping fades out until this speed [m/s] */
static const double STANDSTILL_DAMPING = 0.05; /* [s] */
static const double SLIDING_SPEED = 60.0;     /* keeps the rate of slip below (V + this) / sigma [m/s] */

typedef struct {
    double force, peak, steepness; /* steepness = cornering stiffness / peak */
} Tyre;

typedef struct {
    double slip_angle, force_x, force_y, slip_rate;
} Axle;

typedef struct {
    Axle front, rear;
    double acceleration_x, acceleration_y;
} Motion;

/* Peak factor of one tyre at this load; the guard is the one of plant_models/tyre.py. */
static double peak_factor(double at_nominal, double change, double load, const double v[]) {
    return larger(at_nominal + change * (load / v[TYRE_NOMINAL_LOAD] - 1.0), 0.1);
}

static double cornering_stiffness(double load, const double v[]) {
    if (v[TYRE_P_KY2] <= 0.0) return v[TYRE_P_KY1] * load;
    double t = load / (v[TYRE_P_KY2] * v[TYRE_NOMINAL_LOAD]);
    return v[TYRE_P_KY1] * v[TYRE_NOMINAL_LOAD] * 2.0 * t / (1.0 + t * t); /* = sin(2 atan(t)) */
}

/* Magic Formula, pure lateral slip, one tyre. */
static Tyre lateral(double slip_angle, double load, const double v[]) {
    Tyre tyre = {0.0, 0.0, 0.0};
    if (load <= 0.0 || v[FRICTION] <= 0.0) return tyre;
    tyre.peak = peak_factor(v[TYRE_P_DY1], v[TYRE_P_DY2], load, v) * load * v[FRICTION];
    tyre.steepness = cornering_stiffness(load, v) / tyre.peak;
    double x = tyre.steepness / v[TYRE_P_CY1] * slip_angle;
    tyre.force = tyre.peak * sin(v[TYRE_P_CY1] * atan(x - v[TYRE_P_EY1] * (x - atan(x))));
    return tyre;
}

/* Two tyres under `load` in all, whose wheels move with u, w along and across themselves, asked for `demand`. */
static Axle axle(double u, double w, double slip, double load, double demand, const double v[]) {
    Axle a = {asin(clip(slip, -1.0, 1.0)), 0.0, 0.0, 0.0};
    double speed = sqrt(u * u + w * w), sigma = v[TYRE_RELAXATION_Y], wheel_load = larger(load / 2.0, 0.0);
    double peak_x = 2.0 * peak_factor(v[TYRE_P_DX1], v[TYRE_P_DX2], wheel_load, v) * wheel_load * v[FRICTION];
    double fading = speed < STANDSTILL_SPEED ? 1.0 - speed / STANDSTILL_SPEED : 0.0;
    Tyre tyre = lateral(a.slip_angle, wheel_load, v);
    double damping = STANDSTILL_DAMPING * fading * fading * tyre.steepness * tyre.peak / sigma;
    double used = peak_x > 0.0 ? clip(demand / peak_x, -TYRE_RESERVE, TYRE_RESERVE) : 0.0;
    a.force_x = used * peak_x;
    a.force_y = 2.0 * clip(tyre.force - damping * w, -tyre.peak, tyre.peak) * sqrt(1.0 - used * used);
    double q = tyre.steepness * slip * tyre.steepness * slip; /* > 1: sliding, where the relaxation length shrinks */
    a.slip_rate = (1.0 + q / (1.0 + q * speed / SLIDING_SPEED)) * (-w - speed * slip) / sigma;
    return a;
}

/* Forces on the car in the given state; s points at the integrated states. */
static Motion motion(const double v[], const double s[], double steer_angle) {
    Motion result;
    double m = v[MASS], weight = m * GRAVITY, wheelbase = v[L_F] + v[L_R];
    double v_x = s[V_X - FIRST_STATE], v_y = s[V_Y - FIRST_STATE], r = s[YAW_RATE - FIRST_STATE];
    double delta = steer_angle + v[STEER_OFFSET], c = cos(delta), d = sin(delta);
    double grip = TYRE_RESERVE * v[TYRE_P_DX1] * v[FRICTION] * GRAVITY;
    double a_x = clip(asked_acceleration(v, v_x), -grip, grip);
    double load_f = clip((weight * v[L_R] - m * a_x * v[CG_HEIGHT]) / wheelbase, 0.0, weight);
    double load_r = weight - load_f;
    double front_y = v_y + v[L_F] * r, rear_y = v_y - v[L_R] * r;
    double demand = m * a_x / weight; /* per load: both axles use the same part of their grip */
    result.front = axle(v_x * c + front_y * d, front_y * c - v_x * d, s[FRONT_SLIP - FIRST_STATE],
                        load_f, demand * load_f, v);
    result.rear = axle(v_x, rear_y, s[REAR_SLIP - FIRST_STATE], load_r, demand * load_r, v);
    double body_x = result.front.force_x * c - result.front.force_y * d;
    double body_y = result.front.force_x * d + result.front.force_y * c;
    result.front.force_x = body_x;
    result.front.force_y = body_y;
    result.acceleration_x = (body_x + result.rear.force_x) / m;
    result.acceleration_y = (body_y + result.rear.force_y) / m;
    return result;
}

static Motion moving(const double v[], const double s[], double steer_angle, double rate[]) {
    Motion now = motion(v, s, steer_angle);
    double v_x = s[V_X - FIRST_STATE], v_y = s[V_Y - FIRST_STATE], r = s[YAW_RATE - FIRST_STATE];
    pose_rates(s, rate);
    rate[V_X - FIRST_STATE] = now.acceleration_x + v_y * r;
    rate[V_Y - FIRST_STATE] = now.acceleration_y - v_x * r;
    rate[YAW_RATE - FIRST_STATE] = (v[L_F] * now.front.force_y - v[L_R] * now.rear.force_y) / v[YAW_INERTIA];
    rate[FRONT_SLIP - FIRST_STATE] = now.front.slip_rate;
    rate[REAR_SLIP - FIRST_STATE] = now.rear.slip_rate;
    return now;
}

void model_rates(const double v[], const double s[], double steer_angle, double rate[]) {
    moving(v, s, steer_angle, rate);
}

void model_evaluate(double v[]) {
    Motion now = moving(v, v + FIRST_STATE, v[STEER_ANGLE], v + DER_X);
    v[DER_STEER_ANGLE] = steer_rate(v);
    v[LATERAL_ACCELERATION] = now.acceleration_y;
    v[FRONT_SLIP_ANGLE] = now.front.slip_angle;
    v[REAR_SLIP_ANGLE] = now.rear.slip_angle;
}

/* Slip of tyres that have rolled like this for long. */
static double settled(double u, double w) {
    double speed = sqrt(u * u + w * w);
    return speed > HOLD_SPEED ? -w / speed : 0.0;
}

void model_initialise(double v[]) {
    place(v);
    double delta = v[STEER_ANGLE] + v[STEER_OFFSET], c = cos(delta), d = sin(delta);
    double front_y = v[V_Y] + v[L_F] * v[YAW_RATE], rear_y = v[V_Y] - v[L_R] * v[YAW_RATE];
    v[FRONT_SLIP] = settled(v[V_X] * c + front_y * d, front_y * c - v[V_X] * d);
    v[REAR_SLIP] = settled(v[V_X], rear_y);
}
