# Commands over jobs, workers and files, completion, and the man pages.
target_sources(tessera_client
  PRIVATE bench.cpp bench_figures.cpp bench_reference.cpp compare.cpp completion.cpp curve_svg.cpp event_document.cpp events.cpp extend.cpp farm.cpp fetch.cpp image_file.cpp inspect.cpp
          job_control.cpp list.cpp report.cpp status.cpp table.cpp tile_svg.cpp timeline.cpp true_error.cpp
          workers.cpp
  PUBLIC FILE_SET HEADERS FILES bench_figures.h bench_reference.h completion.h curve_svg.h event_document.h image_file.h table.h
    tile_svg.h timeline.h true_error.h)
target_link_libraries(tessera_client PRIVATE tessera::image)

# tessera-webhook: a client of its own, as the others need no HTTP.
add_library(tessera_webhook)
target_sources(tessera_webhook
  PRIVATE webhook/event_relay.cpp webhook/http_poster.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES webhook/event_relay.h webhook/http_poster.h)
target_compile_definitions(tessera_webhook PRIVATE TESSERA_VERSION="${PROJECT_VERSION}")
target_link_libraries(tessera_webhook PUBLIC tessera::client tessera::log PRIVATE CURL::libcurl)
add_executable(tessera-webhook webhook/main.cpp)
target_compile_definitions(tessera-webhook PRIVATE TESSERA_VERSION="${PROJECT_VERSION}")
target_link_libraries(tessera-webhook PRIVATE tessera_webhook CURL::libcurl CLI11::CLI11)

# `ninja man` writes man/*.1, read off the parser as --help is.
add_executable(tessera_manual EXCLUDE_FROM_ALL manual.cpp)
target_link_libraries(tessera_manual PRIVATE tessera::client CLI11::CLI11)
add_custom_target(man
  COMMAND ${CMAKE_COMMAND} -E make_directory ${PROJECT_BINARY_DIR}/man
  COMMAND tessera_manual ${PROJECT_BINARY_DIR}/man $<TARGET_FILE:tessera-server>
          $<TARGET_FILE:tessera-worker> $<TARGET_FILE:tessera-webhook>
  COMMENT "Writing man pages" VERBATIM)
