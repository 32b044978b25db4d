# Rays, boxes, triangles: what "One hit" is made of.
target_sources(tessera_render
  PRIVATE geometry/exact_sign.cpp geometry/shapes/blob_field.cpp geometry/shapes/blobs.cpp
    geometry/shapes/make_shape.cpp geometry/shapes/polynomial_roots.cpp
    geometry/shapes/quadric.cpp geometry/shapes/shape.cpp geometry/shapes/shape_surface.cpp
    geometry/shapes/terrain.cpp geometry/shapes/terrain_field.cpp geometry/shapes/torus.cpp
    geometry/surface_point.cpp geometry/triangle_overlap.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES geometry/bounds.h geometry/exact_sign.h geometry/frame.h geometry/motion.h geometry/object_ray.h geometry/ray.h
      geometry/shapes/blob_field.h geometry/shapes/clip_line.h geometry/shapes/linear_bound.h geometry/shapes/make_shape.h
      geometry/shapes/polynomial_roots.h geometry/shapes/shape.h geometry/shapes/shape_surface.h geometry/shapes/terrain_field.h
      geometry/surface_point.h geometry/triangle.h geometry/triangle_overlap.h)
