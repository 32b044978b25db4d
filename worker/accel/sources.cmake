# Acceleration structures: which triangle a ray hits first.
target_sources(tessera_render
  PRIVATE accel/scene_accel.cpp accel/wide_bvh.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES accel/brute_force.h accel/lanes.h accel/mesh_triangles.h accel/scene_accel.h
      accel/traverse.h accel/triangle_block.h accel/wide_bvh.h)
