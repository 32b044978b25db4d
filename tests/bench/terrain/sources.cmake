# A terrain beside its tessellations, in pictures and in time.
add_executable(tessera-bench-terrain
  terrain/main.cpp ../support/tessellation.cpp ../support/tessellation.h)
target_link_libraries(tessera-bench-terrain PRIVATE tessera::render CLI11::CLI11)
add_test(NAME bench.terrain COMMAND tessera-bench-terrain --rays 500 --finest 128)
set_tests_properties(bench.terrain PROPERTIES LABELS "integration;long" TIMEOUT ${TESSERA_TEST_SECONDS})
