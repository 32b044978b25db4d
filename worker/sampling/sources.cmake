# Sample points, and maps from them to directions, triangles, filters and tables.
target_sources(tessera_render
  PRIVATE sampling/distribution.cpp sampling/gradient_noise.cpp sampling/pixel_filter.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES sampling/dimensions.h sampling/distribution.h sampling/equi_angular.h sampling/gradient_noise.h sampling/hash.h sampling/pixel_filter.h
      sampling/sampler.h sampling/sobol.h sampling/warp.h)
