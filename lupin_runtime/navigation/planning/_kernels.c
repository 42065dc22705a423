/* Kernels of the planner: `fast_marching.h` for paths with room to both sides, `shortest.h` for the shortest one. */
#include "fast_marching.h"

#include "shortest.h"
