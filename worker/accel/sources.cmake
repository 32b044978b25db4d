# Acceleration structures: which triangle a ray hits first.
target_sources(tessera_render
  PRIVATE accel/binary_bvh.cpp accel/isa.cpp accel/kernel_avx2.cpp accel/kernel_avx512.cpp
    accel/mesh_tree.cpp accel/scene_accel.cpp accel/traversal.inc accel/wide_bvh.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES accel/accel_trees.h accel/binary_bvh.h accel/brute_force.h accel/huge_array.h accel/isa.h
      accel/kernels.h accel/lanes.h accel/mesh_tree.h accel/mesh_triangles.h accel/packed_box.h accel/plain_traversal.h
      accel/scene_accel.h accel/triangle_block.h accel/wide_bvh.h accel/wide_node.h)
if(CMAKE_CXX_COMPILER_ID STREQUAL GNU)  # GCC 12's own AVX-512 intrinsics set it off
  set_source_files_properties(accel/kernel_avx512.cpp PROPERTIES
    COMPILE_OPTIONS -Wno-maybe-uninitialized)
endif()
