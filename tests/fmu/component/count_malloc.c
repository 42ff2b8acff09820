/* Counts what is taken from the heap in steps, in this thread and in a new one. Arguments: setup, states. */
#define _GNU_SOURCE
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include "sidestep.h"

extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
static long counted;

void *malloc(size_t size) { counted++; return __libc_malloc(size); }
void *calloc(size_t n, size_t size) { counted++; return __libc_calloc(n, size); }
void *realloc(void *block, size_t size) { counted++; return __libc_realloc(block, size); }

enum { STEPS = 10000, MOST = 2000, OBSTACLES = 2 };
static sidestep_state states[MOST];
static sidestep_obstacle obstacles[OBSTACLES];
static size_t rows;
static sidestep *controller;

static void *drive(void *out) {
    sidestep_command command;
    long before = counted;
    for (int k = 0; k < STEPS; k++) {
        if (k % (int)rows == 0) sidestep_reset(controller);
        sidestep_step(controller, &states[k % (int)rows], obstacles, OBSTACLES, &command);
        sidestep_clearance(controller, &states[k % (int)rows], obstacles, OBSTACLES);
    }
    *(long *)out = counted - before;
    return NULL;
}

int main(int n, char *names[]) {
    static char setup[1 << 20];
    FILE *file = fopen(names[1], "rb");
    size_t size = fread(setup, 1, sizeof setup, file);
    fclose(file);
    file = fopen(names[2], "rb");
    if (fread(obstacles, sizeof *obstacles, OBSTACLES, file) != OBSTACLES) return 3;
    rows = fread(states, sizeof *states, MOST, file);
    fclose(file);
    const char *problem = "";
    long counts[2] = {-1, -1}, noticed = counted;
    controller = sidestep_create(setup, size, &problem);
    noticed = counted - noticed;
    if (n < 3 || !controller) return puts(problem), 2;
    pthread_t other;
    drive(&counts[0]);
    pthread_create(&other, NULL, drive, &counts[1]);
    pthread_join(other, NULL);
    printf("%ld %ld %ld %zu\n", noticed, counts[0], counts[1], sidestep_arena_peak(controller));
    sidestep_free(controller);
    return 0;
}
