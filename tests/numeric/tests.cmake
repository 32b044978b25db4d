# Tests of this folder (see ../CMakeLists.txt).
tessera_test(NAME render_bsdf KIND numeric SOURCES numeric/render_bsdf.cpp LINKS tessera::render)
tessera_test(NAME geometry KIND numeric
  SOURCES numeric/agreement_test.cpp numeric/tree_quality_test.cpp numeric/geometry_scenes.cpp numeric/geometry_scenes.h numeric/overlap_test.cpp
    numeric/ray_origins_test.cpp numeric/reference_test.cpp numeric/watertight_test.cpp
  LINKS tessera::render)
tessera_test(NAME solids KIND numeric
  SOURCES numeric/blobs_test.cpp numeric/csg_test.cpp numeric/geometry_scenes.cpp numeric/geometry_scenes.h
    numeric/shape_lights_test.cpp
    numeric/shapes_test.cpp numeric/solid_scenes.h numeric/terrain_test.cpp
    numeric/tessellation_test.cpp support/tessellation.cpp support/tessellation.h
  LINKS tessera::render)
# Headers only, with the contraction that everything else forbids.
tessera_test(NAME contraction KIND numeric SOURCES numeric/contraction_test.cpp)
target_compile_options(numeric_contraction_test PRIVATE -ffp-contract=fast)
tessera_test(NAME render_lighting KIND numeric
  SOURCES numeric/render_lighting.cpp numeric/shadow_terminator_test.cpp LINKS tessera_test_render)
tessera_test(NAME render_transparency KIND numeric
  SOURCES numeric/render_transparency.cpp LINKS tessera_test_render)
tessera_test(NAME render_frame KIND numeric
  SOURCES numeric/render_frame.cpp LINKS tessera_test_render)
# No object of the pixel path calls libm.
add_test(NAME numeric.no_libm
  COMMAND ${CMAKE_CURRENT_LIST_DIR}/no_libm.sh $<TARGET_OBJECTS:tessera_render>
  COMMAND_EXPAND_LISTS)
add_test(NAME numeric.exact_reciprocals
  COMMAND ${CMAKE_CURRENT_LIST_DIR}/exact_reciprocals.sh $<TARGET_OBJECTS:tessera_render>
  COMMAND_EXPAND_LISTS)
set_tests_properties(numeric.no_libm numeric.exact_reciprocals PROPERTIES LABELS numeric)
tessera_test(NAME sampling KIND numeric SOURCES numeric/sampling_test.cpp LINKS tessera::render)
tessera_test(NAME render_surface KIND numeric
  SOURCES numeric/render_surface.cpp LINKS tessera_test_render)
tessera_test(NAME optics KIND numeric
  SOURCES numeric/optics_test.cpp LINKS tessera_test_scene tessera::render)
# From a glTF file to the pixel, feature by feature.
tessera_test(NAME gltf KIND numeric
  SOURCES numeric/gltf_materials.cpp numeric/gltf_material_extensions.cpp numeric/gltf_scenes.cpp
    numeric/gltf_solids.cpp
    numeric/material_probe.h
    support/gltf_probe.cpp support/gltf_probe.h
  LINKS tessera_test_render tessera_test_scene PkgConfig::WebP)
tessera_test(NAME camera KIND numeric SOURCES numeric/camera_test.cpp LINKS tessera_test_render)
tessera_test(NAME procedure KIND numeric
  SOURCES numeric/procedure_test.cpp LINKS tessera_test_render)
tessera_test(NAME media KIND numeric
  SOURCES numeric/media_bodies_test.cpp numeric/media_test.cpp numeric/simpson.h LINKS tessera_test_render)
tessera_test(NAME motion KIND numeric
  SOURCES numeric/motion_test.cpp numeric/motion_blur_test.cpp numeric/motion_files.h
    numeric/moving_lights_test.cpp numeric/moving_scenes.h numeric/shutter_test.cpp
    numeric/geometry_scenes.cpp numeric/geometry_scenes.h numeric/solid_scenes.h
  LINKS tessera_test_render tessera_test_scene tessera::render)
# What is chosen by a scene's needs against the general way.
tessera_test(NAME assumed_features KIND numeric
  SOURCES numeric/assumed_features_test.cpp support/folder_reader.cpp support/folder_reader.h
  LINKS tessera_test_render)
target_compile_definitions(numeric_assumed_features_test
  PRIVATE TESSERA_SCENES="${PROJECT_SOURCE_DIR}/tests/scenes")
# Light looked for against light met by chance.
tessera_test(NAME estimators KIND numeric
  SOURCES numeric/estimators_test.cpp support/folder_reader.cpp support/folder_reader.h
  LINKS tessera_test_render)
target_compile_definitions(numeric_estimators_test PRIVATE TESSERA_SCENES="${PROJECT_SOURCE_DIR}/tests/scenes")
