/* Steps the controller of a setup: reads states from standard input, prints commands.
 *
 *     cc example.c libsidestep.a -lm -o example        (or c++; or with libsidestep.so)
 *     echo "0.00 0.0 0.0 0.0 15.0 0.0 0.0 0.0" | ./example controller.setup
 *
 * A state is time, x, y, yaw, v_x, v_y, yaw_rate, steer_angle; a command steering angle, acceleration, target
 * speed, status. */
#include <stdio.h>
#include "sidestep.h"

int main(int count, char **names) {
    static char setup[1 << 20];
    FILE *file = count > 1 ? fopen(names[1], "rb") : NULL;
    size_t size = file ? fread(setup, 1, sizeof setup, file) : 0;
    const char *problem = NULL;
    sidestep *controller = sidestep_create(setup, size, &problem);
    if (file) fclose(file);
    if (!controller || sidestep_abi() != SIDESTEP_ABI) {
        fprintf(stderr, "%s\n", controller ? "header and library are of different versions" : problem);
        return 2;
    }
    sidestep_obstacle obstacle = {40.0, 0.5, 4.5, 1.8, 0.0, 0.0, 0.0}; /* s, l, length, width, heading, speed, time */
    sidestep_state state;
    while (scanf("%lf %lf %lf %lf %lf %lf %lf %lf", &state.time, &state.x, &state.y, &state.yaw, &state.v_x,
                 &state.v_y, &state.yaw_rate, &state.steer_angle) == 8) {
        sidestep_command command;
        if (sidestep_step(controller, &state, &obstacle, 1, &command)) fprintf(stderr, "input not used\n");
        printf("%.17g %.17g %.17g %d\n", command.steer_angle, command.acceleration, command.target_speed,
               (int)command.status);
    }
    sidestep_free(controller);
    return 0;
}
