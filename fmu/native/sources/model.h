/* What a plant core offers to plant.c. All values live in one array, indexed by value reference. */
#ifndef MODEL_H
#define MODEL_H

#include <math.h>
#include "variables.h"

/* States from the start parameters. */
void model_initialise(double v[]);

/* Derivatives and outputs from time, states, inputs and parameters. */
void model_evaluate(double v[]);

/* States after `duration` seconds with all inputs held. */
void model_advance(double v[], double duration);

#endif
