# The glTF loader, from tests/fuzz/corpus/loader.
set(scene_sources
  accessor_reader animation compression container core_model deform first_pass geometry_reader
  hierarchy image_sources json_view material_extensions node_extensions scene_builder uri)
list(TRANSFORM scene_sources PREPEND ${PROJECT_SOURCE_DIR}/worker/scene/)
list(TRANSFORM scene_sources APPEND .cpp)
tessera_fuzz(NAME loader SOURCES ${scene_sources}
  LINKS tessera_test_scene nlohmann_json::nlohmann_json OpenImageIO::OpenImageIO)
