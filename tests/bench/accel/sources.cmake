# Rays a second beside Embree's; Embree is linked here and nowhere else.
find_package(embree 3 CONFIG QUIET)
if(embree_FOUND)
  add_executable(tessera-bench-accel
    accel/agreement.cpp accel/agreement.h accel/embree_peer.cpp
    accel/embree_peer.h accel/figures.cpp accel/figures.h
    accel/first_hits.cpp accel/first_hits.h accel/growth.cpp accel/growth.h
    accel/item_buffer.cpp accel/item_buffer.h accel/main.cpp accel/measure.h
    accel/rays.cpp accel/rays.h accel/scenes.cpp accel/scenes.h
    accel/shapes.cpp accel/shapes.h)
  target_link_libraries(tessera-bench-accel PRIVATE
    tessera::render CLI11::CLI11 nlohmann_json::nlohmann_json embree)
  add_test(NAME bench.accel COMMAND tessera-bench-accel --quick --rounds 1)
  add_test(NAME bench.accel_growth COMMAND tessera-bench-accel --quick --growth)
  add_test(NAME bench.accel_first_hits COMMAND tessera-bench-accel --quick --first-hits)
  add_test(NAME bench.accel_agreement
    COMMAND tessera-bench-accel --quick --agreement 70000 --brute 500 --references)
  set_tests_properties(bench.accel bench.accel_agreement bench.accel_growth bench.accel_first_hits PROPERTIES
    LABELS "integration;long" TIMEOUT ${TESSERA_TEST_SECONDS})
endif()
