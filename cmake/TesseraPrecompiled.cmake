# tessera_precompiled(NAME HEADERS …  LINKS …): a precompiled header for the layers of a directory.
#
# Headers of libraries take most of a build: CLI11 and nlohmann::json a third of the client's, gRPC a
# third of the services'. A directory that sets TESSERA_PRECOMPILED to NAME has its layers use it. A
# source still includes what it uses: -DTESSERA_PRECOMPILED_HEADERS=OFF must build as well.
set(TESSERA_PRECOMPILED_HEADERS ON CACHE STRING "Precompile headers of libraries: ON, OFF, or some of their names")

function(tessera_precompiled name)
  if(NOT TESSERA_PRECOMPILED_HEADERS STREQUAL ON AND NOT name IN_LIST TESSERA_PRECOMPILED_HEADERS)
    return()
  endif()
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "HEADERS;LINKS")
  set(source ${PROJECT_BINARY_DIR}/precompiled/${name}.cpp)
  file(CONFIGURE OUTPUT ${source} CONTENT "")
  add_library(tessera_precompiled_${name} OBJECT ${source})
  target_link_libraries(tessera_precompiled_${name} PRIVATE tessera::flags ${arg_LINKS})
  target_precompile_headers(tessera_precompiled_${name} PRIVATE ${arg_HEADERS})
  # Clang else notes times of files, so that what ccache has from another clone is out of date.
  target_compile_options(tessera_precompiled_${name} PRIVATE
    $<$<CXX_COMPILER_ID:Clang>:SHELL:-Xclang -fno-pch-timestamp>)
endfunction()

# tessera_use_precompiled(TARGET NAME): has one target use it. tessera_layer() and tessera_test() call it.
function(tessera_use_precompiled target name)
  if(TARGET tessera_precompiled_${name})
    target_precompile_headers(${target} REUSE_FROM tessera_precompiled_${name})
  endif()
endfunction()
