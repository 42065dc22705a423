/* Kernels of the planner: `marching.h` for paths with room to both sides, `shortest.h` for the shortest one. */
#include "marching.h"

#include "shortest.h"
