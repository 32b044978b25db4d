# Sample points, and maps from them to directions, triangles, filters and tables.
target_sources(tessera_render
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES sampling/dimensions.h sampling/hash.h sampling/sampler.h sampling/sobol.h)
