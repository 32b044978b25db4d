# Vectors, transforms, and elementary functions with the same bits everywhere.
target_sources(tessera_render
  PRIVATE math/elementary_double.cpp math/elementary_float.cpp math/huge_angle.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES math/elementary.h math/elementary_kernels.h math/float_bits.h
      math/transform.h math/vector.h)
