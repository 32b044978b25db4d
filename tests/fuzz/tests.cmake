# tessera_fuzz(NAME film_block SOURCES … LINKS …): fuzz/NAME_fuzz.cpp defines LLVMFuzzerTestOneInput.
# Everywhere: the test unit.fuzz_NAME replays corpus/NAME. With Clang and AddressSanitizer (preset
# asan): bin/fuzz_NAME, a libFuzzer binary. Name the sources under test, so that they are built with
# its coverage; what comes from LINKS is not.
if(CMAKE_CXX_COMPILER_ID MATCHES Clang AND CMAKE_CXX_FLAGS MATCHES "fsanitize=[a-z,]*address")
  set(tessera_has_fuzzer ON)
endif()
function(tessera_fuzz)
  cmake_parse_arguments(PARSE_ARGV 0 arg "" "NAME" "SOURCES;LINKS")
  add_executable(replay_${arg_NAME} fuzz/replay.cpp fuzz/${arg_NAME}_fuzz.cpp support/sanitizer_options.cpp)
  target_link_libraries(replay_${arg_NAME} PRIVATE tessera::flags ${arg_LINKS})
  add_dependencies(unit_tests replay_${arg_NAME})
  add_test(NAME unit.fuzz_${arg_NAME}
    COMMAND replay_${arg_NAME} ${CMAKE_CURRENT_SOURCE_DIR}/fuzz/corpus/${arg_NAME})
  set_tests_properties(unit.fuzz_${arg_NAME} PROPERTIES LABELS unit TIMEOUT ${TESSERA_TEST_SECONDS})
  if(tessera_has_fuzzer)
    add_executable(fuzz_${arg_NAME} fuzz/${arg_NAME}_fuzz.cpp ${arg_SOURCES} support/sanitizer_options.cpp)
    target_link_libraries(fuzz_${arg_NAME} PRIVATE tessera::flags ${arg_LINKS})
    target_compile_options(fuzz_${arg_NAME} PRIVATE -fsanitize=fuzzer)
    target_link_options(fuzz_${arg_NAME} PRIVATE -fsanitize=fuzzer)
  endif()
endfunction()

tessera_fuzz(NAME film_block
  SOURCES ${PROJECT_SOURCE_DIR}/proto/contract/film_block.cpp LINKS tessera::contract)

include(fuzz/loader.cmake)
