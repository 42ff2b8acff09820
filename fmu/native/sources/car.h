/* What the plant cores share: steering actuator, speed control and integration. */
#ifndef CAR_H
#define CAR_H

#include "model.h"

static const double HOLD_SPEED = 0.1; /* below, the brakes hold the car [m/s] */

static inline double clip(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}
static inline double larger(double a, double b) { return a > b ? a : b; }

/* As commanded, or of the speed control; within the car's limits. */
double asked_acceleration(const double v[], double speed);

/* Rates of x, y and yaw; s points at the integrated states. */
void pose_rates(const double s[], double rate[]);

/* States that have a start parameter, from it. */
void place(double v[]);

/* Of the steering actuator. */
double steer_rate(const double v[]);

/* By the core: rates of the integrated states s, all but the steering angle, which is given. */
void model_rates(const double v[], const double s[], double steer_angle, double rate[]);

#endif
