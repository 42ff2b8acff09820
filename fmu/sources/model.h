/* What a plant core offers to the FMI wrapper. All values live in one array, indexed by value reference. */
#ifndef MODEL_H
#define MODEL_H

#include <math.h>
#include "variables.h"

typedef enum {
    TIME_KIND, INPUT_KIND, STATE_KIND, HIDDEN_STATE_KIND, DERIVATIVE_KIND, OUTPUT_KIND, TUNABLE_KIND, FIXED_KIND
} Kind;

typedef struct {
    const char *name;
    Kind kind;
    double start;
    double minimum;
} Variable;

/* States from the start parameters. */
void model_initialise(double v[]);

/* Derivatives and outputs from time, states, inputs and parameters. */
void model_evaluate(double v[]);

/* States after `duration` seconds with all inputs held. */
void model_advance(double v[], double duration);

#endif
