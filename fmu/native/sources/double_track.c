/* Car on four wheels that rolls; the equations are in documentation/index.html.
 *
 * Signs after ISO 8855: x forward, y left, z up. Positive roll is to the right, as in a turn to the left. x, y, v_x and
 * v_y are those of the centre of gravity.
 */
#include "car.h"
#include "tyre.h"

enum { N_WHEELS = 4 }; /* front left, front right, rear left, rear right */

typedef struct {
    double x, y, c, s;   /* place in the car; cosine and sine of its steering angle */
    double scale, lever; /* of its cornering stiffness; of the centre of gravity above the roll centre */
} Place;

typedef struct {
    double load[N_WHEELS], slip_angle[N_WHEELS], slip_rate[N_WHEELS];
    double force_x, force_y, yaw_moment, roll_moment;
} Motion;

static void places(const double v[], double steer_angle, Place at[]) {
    double delta = steer_angle + v[STEER_OFFSET], c = cos(delta), s = sin(delta);
    double front = 0.5 * v[TRACK_FRONT], rear = 0.5 * v[TRACK_REAR];
    double lever_f = v[CG_HEIGHT] - v[ROLL_CENTRE_FRONT], lever_r = v[CG_HEIGHT] - v[ROLL_CENTRE_REAR];
    at[0] = (Place){v[L_F], front, c, s, v[TYRE_SCALE_FRONT], lever_f};
    at[1] = (Place){v[L_F], -front, c, s, v[TYRE_SCALE_FRONT], lever_f};
    at[2] = (Place){-v[L_R], rear, 1.0, 0.0, v[TYRE_SCALE_REAR], lever_r};
    at[3] = (Place){-v[L_R], -rear, 1.0, 0.0, v[TYRE_SCALE_REAR], lever_r};
}

/* Velocity of a wheel along and across itself. */
static void wheel_velocity(const Place *at, double v_x, double v_y, double r, double *u, double *w) {
    double along = v_x - at->y * r, across = v_y + at->x * r;
    *u = along * at->c + across * at->s;
    *w = across * at->c - along * at->s;
}

/* Loads of an axle's wheels; `moment` is that of springs, dampers and the roll centre against the roll. */
static double share_load(double axle_load, double moment, double track, double load[]) {
    double half = 0.5 * axle_load, transfer = clip(moment / track, -half, half);
    load[0] = half - transfer;
    load[1] = half + transfer;
    return transfer * track;
}

/* `through` is the lateral force that goes through each axle's roll centre. */
static void share_loads(const double v[], const double s[], double a_x, const double through[], Motion *now) {
    double front = front_load(v, a_x), rear = v[MASS] * GRAVITY - front;
    double roll = s[ROLL - FIRST_STATE], rate = s[ROLL_RATE - FIRST_STATE];
    double front_moment = v[ROLL_STIFFNESS_FRONT] * roll + v[ROLL_DAMPING_FRONT] * rate;
    double rear_moment = v[ROLL_STIFFNESS_REAR] * roll + v[ROLL_DAMPING_REAR] * rate;
    front_moment += v[ROLL_CENTRE_FRONT] * through[0];
    rear_moment += v[ROLL_CENTRE_REAR] * through[1];
    now->roll_moment = front * (v[CG_HEIGHT] - v[ROLL_CENTRE_FRONT]) * roll;
    now->roll_moment += rear * (v[CG_HEIGHT] - v[ROLL_CENTRE_REAR]) * roll;
    now->roll_moment -= share_load(front, front_moment, v[TRACK_FRONT], now->load);
    now->roll_moment -= share_load(rear, rear_moment, v[TRACK_REAR], now->load + 2);
}

/* Forces and moments of the tyres under the loads; `axle` is the lateral force of front and rear. */
static void push(const double v[], const double s[], const Place at[], double a_x, Motion *now, double axle[]) {
    double v_x = s[V_X - FIRST_STATE], r = s[YAW_RATE - FIRST_STATE], u, w;
    now->force_x = now->force_y = now->yaw_moment = axle[0] = axle[1] = 0.0;
    for (int i = 0; i < N_WHEELS; i++) {
        double v_y = s[V_Y - FIRST_STATE] + at[i].lever * s[ROLL_RATE - FIRST_STATE]; /* of the road's point below */
        wheel_velocity(&at[i], v_x, v_y, r, &u, &w);
        Wheel tyre = wheel(u, w, s[FRONT_LEFT_SLIP - FIRST_STATE + i], now->load[i], a_x / GRAVITY * now->load[i],
                           at[i].y > 0.0 ? LEFT : RIGHT, at[i].scale, v); /* each uses the same part of its grip */
        double force_x = tyre.force_x * at[i].c - tyre.force_y * at[i].s;
        double force_y = tyre.force_x * at[i].s + tyre.force_y * at[i].c;
        now->force_x += force_x;
        now->force_y += force_y;
        now->yaw_moment += at[i].x * force_y - at[i].y * force_x;
        now->slip_angle[i] = tyre.slip_angle;
        now->slip_rate[i] = tyre.slip_rate;
        axle[i / 2] += force_y;
    }
}

/* Forces and moments on the car in the given state; s points at the integrated states. */
static Motion motion(const double v[], const double s[], double steer_angle) {
    Motion now = {.force_x = 0.0};
    Place at[N_WHEELS];
    double a_x = asked_of_tyres(v, s[V_X - FIRST_STATE]), axle[2] = {0.0, 0.0}, last[2];
    places(v, steer_angle, at);
    share_loads(v, s, a_x, axle, &now);
    push(v, s, at, a_x, &now, axle);
    if (v[ROLL_CENTRE_FRONT] != 0.0 || v[ROLL_CENTRE_REAR] != 0.0) { /* loads that depend on the forces: once more */
        share_loads(v, s, a_x, axle, &now);
        push(v, s, at, a_x, &now, last);
    }
    now.roll_moment += v[CG_HEIGHT] * now.force_y;
    return now;
}

static Motion moving(const double v[], const double s[], double steer_angle, double rate[]) {
    Motion now = motion(v, s, steer_angle);
    double v_x = s[V_X - FIRST_STATE], v_y = s[V_Y - FIRST_STATE], r = s[YAW_RATE - FIRST_STATE];
    pose_rates(s, rate);
    rate[V_X - FIRST_STATE] = now.force_x / v[MASS] + v_y * r;
    rate[V_Y - FIRST_STATE] = now.force_y / v[MASS] - v_x * r;
    rate[YAW_RATE - FIRST_STATE] = now.yaw_moment / v[YAW_INERTIA];
    rate[ROLL - FIRST_STATE] = s[ROLL_RATE - FIRST_STATE];
    rate[ROLL_RATE - FIRST_STATE] = now.roll_moment / v[ROLL_INERTIA];
    for (int i = 0; i < N_WHEELS; i++) rate[FRONT_LEFT_SLIP - FIRST_STATE + i] = now.slip_rate[i];
    return now;
}

void model_rates(const double v[], const double s[], double steer_angle, double rate[]) {
    moving(v, s, steer_angle, rate);
}

void model_evaluate(double v[]) {
    Motion now = moving(v, v + FIRST_STATE, v[STEER_ANGLE], v + DER_X);
    v[DER_STEER_ANGLE] = steer_rate(v);
    v[LATERAL_ACCELERATION] = v[DER_V_Y] + v[V_X] * v[YAW_RATE];
    for (int i = 0; i < N_WHEELS; i++) {
        v[FRONT_LEFT_LOAD + i] = now.load[i];
        v[FRONT_LEFT_SLIP_ANGLE + i] = now.slip_angle[i];
    }
}

void model_initialise(double v[]) {
    Place at[N_WHEELS];
    double u, w;
    place(v);
    v[ROLL] = v[ROLL_RATE] = 0.0;
    places(v, v[STEER_ANGLE], at);
    for (int i = 0; i < N_WHEELS; i++) {
        wheel_velocity(&at[i], v[V_X], v[V_Y], v[YAW_RATE], &u, &w);
        v[FRONT_LEFT_SLIP + i] = settled_slip(u, w);
    }
}
