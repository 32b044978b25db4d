# tessera-bench-coverage: claims of --error against the truth.
add_executable(tessera-bench-coverage
  coverage/coverage.cpp coverage/reference.cpp coverage/reference.h ../support/folder_reader.cpp
  ../support/folder_reader.h ../support/seeded_frames.cpp ../support/seeded_frames.h)
target_link_libraries(tessera-bench-coverage PRIVATE tessera::film tessera::render CLI11::CLI11
  nlohmann_json::nlohmann_json)

# A short version of tests/bench/coverage.sh; it asks whether claims hold, and never how fast.
add_test(NAME bench.coverage
  COMMAND ${PROJECT_SOURCE_DIR}/tests/bench/coverage.sh --seeds 8 --bin ${CMAKE_RUNTIME_OUTPUT_DIRECTORY}
          furnace checker)
set_tests_properties(bench.coverage PROPERTIES LABELS "integration;long" TIMEOUT ${TESSERA_TEST_SECONDS} PROCESSORS 2)
