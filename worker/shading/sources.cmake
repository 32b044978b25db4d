target_sources(tessera_render
  PRIVATE shading/albedo_table.cpp shading/anisotropic_albedo.cpp shading/bsdf.cpp shading/extended_bsdf.cpp shading/medium.cpp shading/procedure.cpp shading/shading_scene.cpp shading/sheen.cpp shading/thin_film.cpp shading/srgb.cpp
          shading/surface.cpp shading/surface_extensions.cpp shading/surface_procedure.cpp shading/texture.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES shading/albedo_table.h shading/anisotropic_albedo.h shading/dispersion.h shading/half_circle.h shading/sheen.h shading/thin_film.h shading/base_bsdf.h shading/base_facets.h shading/base_prepare.h shading/bsdf.h shading/extended_bsdf.h shading/fresnel.h shading/medium.h shading/microfacet.h shading/phase.h
          shading/procedure.h shading/rough_diffuse.h shading/shading_scene.h shading/srgb.h shading/surface.h shading/surface_extensions.h shading/surface_lookup.h shading/surface_procedure.h shading/texture.h)
