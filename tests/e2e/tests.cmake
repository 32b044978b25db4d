# End-to-end tests: real programs in private folders. They need tests/e2e/farm.sh and no network.
add_test(NAME unit.scenes_are_what_their_script_writes
  COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/scenes/make_scenes.py --check)
add_test(NAME unit.documents_speak_of_what_is_there
  COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/documents_check.py)
set_tests_properties(unit.scenes_are_what_their_script_writes unit.documents_speak_of_what_is_there
  PROPERTIES LABELS unit)
if(TESSERA_WITH_GRPC)
  # tessera_e2e(NAME SECONDS): runs e2e/NAME.sh. Sanitizer builds run smaller jobs.
  function(tessera_e2e name seconds)
    add_test(NAME e2e.${name} COMMAND ${CMAKE_CURRENT_SOURCE_DIR}/e2e/${name}.sh)
    set(environment TESSERA_BIN=${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
    if(CMAKE_CXX_FLAGS MATCHES "sanitize")
      list(APPEND environment TESSERA_E2E_SMALL=1 ASAN_OPTIONS=intercept_tls_get_addr=0
        LSAN_OPTIONS=suppressions=${CMAKE_CURRENT_SOURCE_DIR}/e2e/leaks.supp:print_suppressions=0)
    endif()
    set_tests_properties(e2e.${name} PROPERTIES LABELS e2e TIMEOUT ${seconds}
      ENVIRONMENT "${environment}")
  endfunction()

  # Limits are for sanitizer builds on two busy cores; a dev build takes a tenth. Most of it is
  # waiting, so they share the cores.
  tessera_e2e(same_bits 400)
  tessera_e2e(same_bits_crashes 400)
  tessera_e2e(same_bits_cover 400)
  # What takes longest begins first, so that nothing is left to run alone.
  set_tests_properties(e2e.same_bits e2e.same_bits_cover PROPERTIES COST 100)
  # All 72 combinations: TESSERA_OTHER_BIN=… cmake --build --preset dev --target same_bits_all
  add_custom_target(same_bits_all USES_TERMINAL
    COMMAND ${CMAKE_COMMAND} -E env TESSERA_BIN=${CMAKE_RUNTIME_OUTPUT_DIRECTORY}
            ASAN_OPTIONS=intercept_tls_get_addr=0
            ${CMAKE_CURRENT_SOURCE_DIR}/e2e/same_bits_cover.sh --all
            ${CMAKE_CURRENT_SOURCE_DIR}/scenes/same_bits.gltf
    DEPENDS tessera tessera-server tessera-worker)
  tessera_e2e(by_error 400)
  tessera_e2e(bench 300)
  tessera_e2e(failures 400)
  tessera_e2e(command_line 300)
  tessera_e2e(render_alone 300)
  tessera_e2e(secure_farm 300)
  tessera_e2e(metrics 300)
  tessera_e2e(documented_commands 300)
  tessera_e2e(farm_up_down 300)
  tessera_e2e(operators 300)
  # What the asan stage of .ci/run has no time for; `ctest --preset asan-long` runs it.
  set_tests_properties(e2e.same_bits_crashes e2e.same_bits_cover e2e.by_error e2e.bench
    e2e.command_line e2e.metrics e2e.documented_commands e2e.farm_up_down PROPERTIES LABELS "e2e;long")
  # Where their tools are not installed these say SKIPPED and why.
  tessera_e2e(systemd_units 60)
  tessera_e2e(slurm 600)
  tessera_e2e(kubernetes 600)
  tessera_e2e(containers 600)
  set_tests_properties(e2e.systemd_units e2e.slurm e2e.kubernetes e2e.containers
    PROPERTIES SKIP_REGULAR_EXPRESSION "SKIPPED")
  # The image, which takes minutes, and the tests that run it: cmake --build --preset dev --target containers
  add_custom_target(containers USES_TERMINAL
    COMMAND ${CMAKE_COMMAND} -E env TESSERA_BIN=${CMAKE_RUNTIME_OUTPUT_DIRECTORY}
            ${CMAKE_CURRENT_SOURCE_DIR}/e2e/containers.sh --build
    DEPENDS tessera tessera-server tessera-worker)

  # Chaos puts a library of its own before the C library's functions, as sanitizers do: not both.
  if(NOT CMAKE_CXX_FLAGS MATCHES "sanitize")
    add_library(tessera_faults MODULE e2e/chaos/faults.cpp)
    set_target_properties(tessera_faults PROPERTIES PREFIX ""
      LIBRARY_OUTPUT_DIRECTORY ${CMAKE_RUNTIME_OUTPUT_DIRECTORY})
    target_link_libraries(tessera_faults PRIVATE tessera::flags ${CMAKE_DL_LIBS})
    add_executable(tessera_wide_area_link support/wide_area_link.cpp)
    target_link_libraries(tessera_wide_area_link PRIVATE tessera::flags)
    tessera_e2e(chaos 1800)
    tessera_e2e(dead_worker 300)
    set_tests_properties(e2e.dead_worker PROPERTIES PROCESSORS 2)  # it measures time
    set_tests_properties(e2e.chaos PROPERTIES COST 200)
    # The soak: cmake --build --preset dev --target soak
    add_custom_target(soak USES_TERMINAL
      COMMAND ${CMAKE_COMMAND} -E env TESSERA_BIN=${CMAKE_RUNTIME_OUTPUT_DIRECTORY}
              ${CMAKE_CURRENT_SOURCE_DIR}/e2e/chaos.sh --rounds 200
      DEPENDS tessera tessera-server tessera-worker tessera_faults tessera_wide_area_link)
  endif()
endif()
