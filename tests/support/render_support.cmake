# tessera_test_render: scenes as plain data and small renders of them, for tests.
add_library(tessera_test_render STATIC
  ${CMAKE_CURRENT_LIST_DIR}/assumed_features.cpp ${CMAKE_CURRENT_LIST_DIR}/assumed_features.h
  ${CMAKE_CURRENT_LIST_DIR}/plain_scene.cpp ${CMAKE_CURRENT_LIST_DIR}/plain_scene.h)
target_link_libraries(tessera_test_render PUBLIC tessera::render)

# tessera_render_once: a frame through tessera_render linked alone.
add_executable(tessera_render_once
  ${CMAKE_CURRENT_LIST_DIR}/render_once.cpp ${CMAKE_CURRENT_LIST_DIR}/folder_reader.cpp
  ${CMAKE_CURRENT_LIST_DIR}/folder_reader.h)
target_link_libraries(tessera_render_once PRIVATE tessera_test_render tessera::image CLI11::CLI11)
