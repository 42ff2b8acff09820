/* What the plant cores share: steering actuator, speed control and integration. */
#include "car.h"

enum { N_INTEGRATED = STEER_ANGLE - FIRST_STATE }; /* the steering actuator is solved exactly instead */

double asked_acceleration(const double v[], double speed) {
    double wanted = v[ACCELERATION];
    if (!(wanted < NO_ACCELERATION)) {
        wanted = v[SPEED_GAIN] * (larger(v[TARGET_SPEED], 0.0) - speed);
        return clip(wanted, -v[MAX_BRAKING], v[MAX_ACCELERATION]);
    }
    if (wanted >= 0.0) return clip(wanted, 0.0, v[MAX_ACCELERATION]);
    return larger(wanted, -v[MAX_BRAKING]) * clip(speed / HOLD_SPEED, -1.0, 1.0); /* brakes do not drive */
}

void pose_rates(const double s[], double rate[]) {
    double c = cos(s[YAW - FIRST_STATE]), d = sin(s[YAW - FIRST_STATE]);
    rate[X - FIRST_STATE] = s[V_X - FIRST_STATE] * c - s[V_Y - FIRST_STATE] * d;
    rate[Y - FIRST_STATE] = s[V_X - FIRST_STATE] * d + s[V_Y - FIRST_STATE] * c;
    rate[YAW - FIRST_STATE] = s[YAW_RATE - FIRST_STATE];
}

void place(double v[]) {
    v[X] = v[X_0];
    v[Y] = v[Y_0];
    v[YAW] = v[YAW_0];
    v[V_X] = v[V_X_0];
    v[V_Y] = v[V_Y_0];
    v[YAW_RATE] = v[YAW_RATE_0];
    v[STEER_ANGLE] = v[STEER_ANGLE_0];
}

/* Steering actuator after t seconds: rate limit until the lag asks for less, then exponential. Exact. */
static double steered(const double v[], double start, double t) {
    double command = clip(v[STEER_ANGLE_COMMAND], -v[STEER_LIMIT], v[STEER_LIMIT]);
    double lag = v[STEER_TIME_CONSTANT], rate = v[STEER_RATE_LIMIT];
    double error = command - start, limited = larger(fabs(error) - lag * rate, 0.0);
    if (limited >= rate * t) return start + (error > 0.0 ? rate * t : -rate * t);
    if (lag <= 0.0) return command;
    double rest = error > 0.0 ? fabs(error) - limited : limited - fabs(error);
    return command - rest * exp(-(t - (limited > 0.0 ? limited / rate : 0.0)) / lag);
}

double steer_rate(const double v[]) {
    double error = clip(v[STEER_ANGLE_COMMAND], -v[STEER_LIMIT], v[STEER_LIMIT]) - v[STEER_ANGLE];
    double rate = v[STEER_RATE_LIMIT];
    if (v[STEER_TIME_CONSTANT] > 0.0) return clip(error / v[STEER_TIME_CONSTANT], -rate, rate);
    return error > 0.0 ? rate : error < 0.0 ? -rate : 0.0;
}

/* One step of the classical fourth-order Runge-Kutta method. */
static void runge_kutta(double v[], double h) {
    double k1[N_INTEGRATED], k2[N_INTEGRATED], k3[N_INTEGRATED], k4[N_INTEGRATED], s[N_INTEGRATED];
    double *x = v + FIRST_STATE, start = v[STEER_ANGLE];
    double middle = steered(v, start, h / 2.0), end = steered(v, start, h);
    model_rates(v, x, start, k1);
    for (int i = 0; i < N_INTEGRATED; i++) s[i] = x[i] + h / 2.0 * k1[i];
    model_rates(v, s, middle, k2);
    for (int i = 0; i < N_INTEGRATED; i++) s[i] = x[i] + h / 2.0 * k2[i];
    model_rates(v, s, middle, k3);
    for (int i = 0; i < N_INTEGRATED; i++) s[i] = x[i] + h * k3[i];
    model_rates(v, s, end, k4);
    for (int i = 0; i < N_INTEGRATED; i++) x[i] += h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]);
    v[STEER_ANGLE] = end;
}

void model_advance(double v[], double duration) {
    double steps = larger(ceil(duration / v[INTERNAL_STEP] - 1e-9), 1.0), h = duration / steps;
    for (double k = 0.0; k < steps; k += 1.0) {
        int rolled_forward = v[V_X] >= 0.0;
        runge_kutta(v, h);
        if (rolled_forward && v[V_X] < 0.0 && v[V_X] * v[V_X] + v[V_Y] * v[V_Y] < HOLD_SPEED * HOLD_SPEED) v[V_X] = 0.0;
    }
}
