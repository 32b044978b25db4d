target_sources(tessera_render
  PRIVATE shading/albedo_table.cpp shading/bsdf.cpp shading/extended_bsdf.cpp shading/shading_scene.cpp shading/srgb.cpp
          shading/surface.cpp shading/surface_extensions.cpp shading/texture.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES shading/albedo_table.h shading/base_bsdf.h shading/bsdf.h shading/extended_bsdf.h shading/fresnel.h shading/microfacet.h
          shading/shading_scene.h shading/srgb.h shading/surface.h shading/surface_extensions.h shading/surface_lookup.h shading/texture.h)
