#pragma once

// Everything that the traversal templates of this folder include, except each other.
//
// The AVX-512 files include the templates inside a target region (see avx512.h). A header that is
// first included there is compiled for AVX-512 too, and the linker, which keeps one copy of each
// inline function, may then give that copy to code that runs on processors without AVX-512. So the
// templates include nothing but this header, and avx512.h includes it before any region begins.

#include <immintrin.h>

#include <cassert>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

#include "worker/accel/layout/lanes.h"
#include "worker/accel/layout/scene_bvh.h"
#include "worker/accel/layout/triangle_block.h"
#include "worker/accel/layout/wide_node.h"
#include "worker/accel/solids/solids.h"
#include "worker/accel/traversal/hit_filter.h"
#include "worker/geometry/motion.h"
#include "worker/geometry/object_ray.h"
#include "worker/geometry/ray.h"
#include "worker/math/transform.h"
