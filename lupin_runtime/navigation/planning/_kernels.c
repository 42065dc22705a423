/* Kernels of the planner: `marching.h` for paths with room to both sides, `shortest.h` and `tightening.h` for the shortest one. */
#include "marching.h"

#include "tightening.h"

#include "shortest.h"
