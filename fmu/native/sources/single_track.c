/* Nonlinear single-track car; the equations are in documentation/index.html. */
#include "car.h"
#include "tyre.h"

typedef struct {
    Wheel front, rear; /* forces of both tyres of the axle, in the car's axes */
    double acceleration_x, acceleration_y;
} Motion;

/* Both tyres of an axle. */
static Wheel axle(double u, double w, double slip, double load, double demand, double scale,
                  const double v[]) {
    Wheel left = wheel(u, w, slip, 0.5 * load, 0.5 * demand, LEFT, scale, v);
    Wheel right = has_sides(v) ? wheel(u, w, slip, 0.5 * load, 0.5 * demand, RIGHT, scale, v) : left;
    left.force_x += right.force_x;
    left.force_y += right.force_y;
    return left;
}

/* Forces on the car in the given state; s points at the integrated states. */
static Motion motion(const double v[], const double s[], double steer_angle) {
    Motion result;
    double m = v[MASS], weight = m * GRAVITY;
    double v_x = s[V_X - FIRST_STATE], v_y = s[V_Y - FIRST_STATE], r = s[YAW_RATE - FIRST_STATE];
    double delta = steer_angle + v[STEER_OFFSET], c = cos(delta), d = sin(delta);
    double a_x = asked_of_tyres(v, v_x), load_f = front_load(v, a_x), load_r = weight - load_f;
    double front_y = v_y + v[L_F] * r, rear_y = v_y - v[L_R] * r;
    double demand = m * a_x / weight; /* per load: both axles use the same part of their grip */
    result.front = axle(v_x * c + front_y * d, front_y * c - v_x * d, s[FRONT_SLIP - FIRST_STATE],
                        load_f, demand * load_f, v[TYRE_SCALE_FRONT], v);
    result.rear = axle(v_x, rear_y, s[REAR_SLIP - FIRST_STATE], load_r, demand * load_r, v[TYRE_SCALE_REAR], v);
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

void model_initialise(double v[]) {
    place(v);
    double delta = v[STEER_ANGLE] + v[STEER_OFFSET], c = cos(delta), d = sin(delta);
    double front_y = v[V_Y] + v[L_F] * v[YAW_RATE], rear_y = v[V_Y] - v[L_R] * v[YAW_RATE];
    v[FRONT_SLIP] = settled_slip(v[V_X] * c + front_y * d, front_y * c - v[V_X] * d);
    v[REAR_SLIP] = settled_slip(v[V_X], rear_y);
}
