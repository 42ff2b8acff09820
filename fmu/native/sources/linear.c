/* Linear single-track car, Eq. (5) in v_y = beta v_x; the equations are in documentation/index.html. */
#include "car.h"

static const double SLIP_SPEED = 1.5; /* below, the slip angle is regularised [m/s] */

void model_rates(const double v[], const double s[], double steer_angle, double rate[]) {
    double v_x = s[V_X - FIRST_STATE], v_y = s[V_Y - FIRST_STATE], r = s[YAW_RATE - FIRST_STATE];
    double delta = steer_angle + v[STEER_OFFSET], speed = larger(fabs(v_x), SLIP_SPEED);
    double front = v[CORNERING_STIFFNESS_FRONT] * (delta * v_x - v_y - v[L_F] * r) / speed;
    double rear = v[CORNERING_STIFFNESS_REAR] * (v[L_R] * r - v_y) / speed;
    pose_rates(s, rate);
    rate[V_X - FIRST_STATE] = asked_acceleration(v, v_x);
    rate[V_Y - FIRST_STATE] = (front + rear) / v[MASS] - v_x * r;
    rate[YAW_RATE - FIRST_STATE] = (v[L_F] * front - v[L_R] * rear) / v[YAW_INERTIA];
}

void model_evaluate(double v[]) {
    model_rates(v, v + FIRST_STATE, v[STEER_ANGLE], v + DER_X);
    v[DER_STEER_ANGLE] = steer_rate(v);
    v[LATERAL_ACCELERATION] = v[DER_V_Y] + v[V_X] * v[YAW_RATE];
}

void model_initialise(double v[]) { place(v); }
