# tessera_test_scene: glTF files made in memory, loaded and posed, for tests.
add_library(tessera_test_scene STATIC
  ${CMAKE_CURRENT_LIST_DIR}/gltf_builder.cpp ${CMAKE_CURRENT_LIST_DIR}/gltf_builder.h
  ${CMAKE_CURRENT_LIST_DIR}/memory_scene.cpp ${CMAKE_CURRENT_LIST_DIR}/memory_scene.h)
target_link_libraries(tessera_test_scene PUBLIC tessera::render PRIVATE nlohmann_json::nlohmann_json)
