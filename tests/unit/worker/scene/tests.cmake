# The loader: one binary over all of its parts.
tessera_test(NAME scene KIND unit
  SOURCES
    unit/worker/scene/accessor_test.cpp unit/worker/scene/animation_pointer_test.cpp unit/worker/scene/animation_test.cpp
    unit/worker/scene/compression_test.cpp unit/worker/scene/container_test.cpp
    unit/worker/scene/extensions_test.cpp unit/worker/scene/inspect_test.cpp
    unit/worker/scene/malformed_test.cpp unit/worker/scene/material_test.cpp
    unit/worker/scene/pose_cache_test.cpp
    unit/worker/scene/pose_test.cpp unit/worker/scene/shape_test.cpp
    unit/worker/scene/tangents_test.cpp
  LINKS tessera::render tessera_test_scene tessera_schema_check draco::draco meshoptimizer::meshoptimizer
    nlohmann_json::nlohmann_json)
target_compile_definitions(unit_scene_test PRIVATE TESSERA_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
tessera_test(NAME memory KIND unit SOURCES unit/worker/scene/memory_test.cpp
  LINKS tessera_test_render)
# Apart, since each of its processes loads OpenImageIO to write what is then read.
tessera_test(NAME image KIND unit SOURCES unit/worker/scene/image_test.cpp
  LINKS tessera::render OpenImageIO::OpenImageIO PkgConfig::WebP)
