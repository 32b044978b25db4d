# Acceleration structures: which triangle a ray hits first.
target_sources(tessera_render
  PRIVATE accel/avx2_lanes.inc accel/avx512_lanes.inc accel/binary_bvh.cpp accel/csg_line.cpp
    accel/instance_boxes.cpp accel/isa.cpp accel/kernel_avx2.cpp accel/kernel_avx2_solids.cpp
    accel/kernel_avx512.cpp accel/kernel_avx512_solids.cpp accel/kernel_avx2_motion.cpp
    accel/kernel_avx512_motion.cpp accel/mesh_overlap.cpp
    accel/mesh_tree.cpp accel/motion_traversal.inc accel/moving_tree.cpp accel/packet.inc accel/refit.cpp accel/reinsertion.cpp
    accel/scene_accel.cpp accel/shadow_cache.cpp accel/solid_traversal.inc accel/solids.cpp
    accel/traversal.inc accel/tree_quality.cpp accel/wide_bvh.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES accel/accel_trees.h accel/binary_bvh.h accel/brute_force.h accel/build_quality.h
      accel/csg_line.h accel/huge_array.h
      accel/instance_boxes.h accel/isa.h accel/kernels.h accel/lanes.h accel/mesh_overlap.h
      accel/mesh_tree.h accel/mesh_triangles.h accel/moving_tree.h accel/packed_box.h accel/plain_traversal.h accel/ray_queries.h
      accel/reinsertion.h accel/scene_accel.h accel/shadow_cache.h
      accel/solids.h accel/tree_quality.h accel/triangle_block.h accel/wide_bvh.h accel/wide_node.h)
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)  # GCC 12's own AVX-512 intrinsics set them off
  set_source_files_properties(accel/kernel_avx512.cpp accel/kernel_avx512_solids.cpp
    accel/kernel_avx512_motion.cpp PROPERTIES
    COMPILE_OPTIONS "-Wno-unknown-warning-option;-Wno-maybe-uninitialized;-Wno-uninitialized")  # the first for clang-tidy
endif()
# The structures that production is compared with: small, plain, one a file.
target_sources(tessera_render
  PRIVATE accel/reference/brute_force.cpp accel/reference/depth_first.cpp accel/reference/grid.cpp
    accel/reference/hierarchical_grid.cpp accel/reference/kd_tree.cpp accel/reference/octree.cpp
    accel/reference/oriented_boxes.cpp accel/reference/polygon_bsp.cpp
    accel/reference/proximity_grid.cpp accel/reference/recursive_grid.cpp
    accel/reference/reference_accel.cpp accel/reference/shapes.cpp accel/reference/skip_bvh.cpp
    accel/reference/sphere_tree.cpp accel/reference/structures.cpp
    accel/reference/two_wide_bvh.cpp accel/reference/uniform_grid.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES accel/reference/depth_first.h accel/reference/grid.h accel/reference/reference_accel.h
      accel/reference/shapes.h accel/reference/structures.h)
