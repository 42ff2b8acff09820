/* sidestep: corridor planner and model predictive controller, one step at a time. Generated: do not edit.
 *
 * SI units, radians, axes of ISO 8855 (x forward, y left, yaw and steering positive to the left). An instance belongs
 * to one thread at a time; different instances may run in different threads. A step takes no memory from the heap, no
 * lock and no file. The functions that return an int return SIDESTEP_OK or the reason.
 */
#ifndef SIDESTEP_H
#define SIDESTEP_H

#include <stddef.h>
#include <stdint.h>

#if defined _WIN32 && defined SIDESTEP_BUILD_SHARED
#define SIDESTEP_API __declspec(dllexport)
#elif defined __GNUC__
#define SIDESTEP_API __attribute__((visibility("default")))
#else
#define SIDESTEP_API
#endif

#ifdef __cplusplus
extern "C" {
#endif

#define SIDESTEP_VERSION "$version"
#define SIDESTEP_ABI $abi /* of the structs below and of setup files: changes with each of them */
#define SIDESTEP_MOST_OBSTACLES $obstacles

enum { SIDESTEP_OK, SIDESTEP_INPUT, SIDESTEP_TOO_MANY, SIDESTEP_ARENA, SIDESTEP_FOREIGN, SIDESTEP_RANGE };
enum { SIDESTEP_TRACKING, SIDESTEP_DEGRADED, SIDESTEP_BLOCKED, SIDESTEP_FAULT }; /* status of a command */

typedef struct sidestep sidestep;

$structs/* SIDESTEP_ABI of the library, to be compared with the header's. */
SIDESTEP_API uint32_t sidestep_abi(void);

/* An instance of a setup (see `sidestep export c`); NULL if it cannot be, then `problem` says why. */
SIDESTEP_API sidestep *sidestep_create(const void *setup, size_t size, const char **problem);
SIDESTEP_API void sidestep_free(sidestep *controller);

/* Forget all earlier steps. */
SIDESTEP_API void sidestep_reset(sidestep *controller);

/* Plan, predict, optimise: state and obstacles in, the command to hold until the next step out. Times grow from step
 * to step. SIDESTEP_OK, or why the input was not used and the last good plan is followed: SIDESTEP_INPUT (a state or
 * an obstacle is no number of its range), SIDESTEP_TOO_MANY obstacles, SIDESTEP_ARENA (room for obstacles ran out). */
SIDESTEP_API int sidestep_step(sidestep *controller, const sidestep_state *state, const sidestep_obstacle obstacles[],
                               size_t count, sidestep_command *command);

/* What was behind the last command; NULL before the first step. The next step overwrites it. */
SIDESTEP_API const sidestep_plan *sidestep_last_plan(const sidestep *controller);

/* Distance from the car to the nearest obstacle at the state's time, 0 on contact, 1000 where there is none, in [m]. */
SIDESTEP_API double sidestep_clearance(sidestep *controller, const sidestep_state *state,
                                       const sidestep_obstacle obstacles[], size_t count);

/* Settings in force; new ones hold from the next step on. SIDESTEP_RANGE if one is no number. */
SIDESTEP_API void sidestep_get_parameters(const sidestep *controller, sidestep_parameters *parameters);
SIDESTEP_API int sidestep_set_parameters(sidestep *controller, const sidestep_parameters *parameters);

/* All that lasts from step to step, as SteeringController.save() gives it. SIDESTEP_FOREIGN for bytes of another
 * version, of another size, or damaged. */
SIDESTEP_API size_t sidestep_memory_size(void);
SIDESTEP_API int sidestep_save(const sidestep *controller, void *bytes, size_t size);
SIDESTEP_API int sidestep_restore(sidestep *controller, const void *bytes, size_t size);

/* Bytes of one instance, and the most that a step has used of those for its own work. */
SIDESTEP_API size_t sidestep_instance_size(const sidestep *controller);
SIDESTEP_API size_t sidestep_arena_peak(const sidestep *controller);

#ifdef __cplusplus
}
#endif

#endif
