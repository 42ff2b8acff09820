/* Magic-Formula tyres with relaxation, and what the cars that stand on them share. */
#ifndef TYRE_H
#define TYRE_H

static const double LEFT = 1.0, RIGHT = -1.0; /* a tyre with shifts is mounted mirrored on the right */

typedef struct {
    double slip_angle, force_x, force_y, slip_rate;
} Wheel;

/* A wheel under `load` that moves with u, w along and across itself, asked for the force `demand` along itself;
 * slip is the sine of its slip angle after relaxation, scale the factor on its cornering stiffness. */
Wheel wheel(double u, double w, double slip, double load, double demand, double side, double scale, const double v[]);

/* Slip of a tyre that has rolled like this for long. */
double settled_slip(double u, double w);

/* Acceleration that is asked of the tyres: that of the speed control, within their grip. */
double asked_of_tyres(const double v[], double speed);

/* Load of the front axle at this acceleration, quasi-static. */
double front_load(const double v[], double a_x);

/* Whether left and right tyres differ. */
int has_sides(const double v[]);

#endif
