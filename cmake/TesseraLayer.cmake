# tessera_layer(NAME SOURCES … HEADERS … PUBLIC … PRIVATE …): the library of one folder.
#
# A target sees the headers of the layers it links and no others: each header is staged as a link in
# a folder of its layer, and only that folder is on the include path. An include of a layer that is
# not linked does not compile, so the picture of the layers in docs/explanation matches the code.
#
#   NAME      accel_layout makes the target tessera_accel_layout, known as tessera::accel_layout
#   HEADERS   headers of the folder, all of which must compile on their own
#   PUBLIC    layers and libraries that the headers include
#   PRIVATE   layers and libraries that only the sources include
function(tessera_layer name)
  cmake_parse_arguments(PARSE_ARGV 1 arg "" "" "SOURCES;HEADERS;PUBLIC;PRIVATE")
  set(target tessera_${name})
  set(staging ${PROJECT_BINARY_DIR}/layers/${name})
  file(RELATIVE_PATH folder ${PROJECT_SOURCE_DIR} ${CMAKE_CURRENT_SOURCE_DIR})
  file(REMOVE_RECURSE ${staging})
  file(MAKE_DIRECTORY ${staging}/${folder})
  set(headers "")
  foreach(header IN LISTS arg_HEADERS)
    file(CREATE_LINK ${CMAKE_CURRENT_SOURCE_DIR}/${header} ${staging}/${folder}/${header} SYMBOLIC)
    list(APPEND headers ${staging}/${folder}/${header})
  endforeach()
  if(arg_SOURCES)
    set(scope PUBLIC)
    add_library(${target} STATIC ${arg_SOURCES})
    target_link_libraries(${target} PUBLIC tessera::flags ${arg_PUBLIC} PRIVATE ${arg_PRIVATE})
    tessera_use_precompiled(${target} ${TESSERA_PRECOMPILED})
  else()
    set(scope INTERFACE)
    add_library(${target} INTERFACE)
    target_link_libraries(${target} INTERFACE tessera::flags ${arg_PUBLIC})
  endif()
  add_library(tessera::${name} ALIAS ${target})
  target_sources(${target} ${scope} FILE_SET HEADERS BASE_DIRS ${staging} FILES ${headers})
  set_property(GLOBAL APPEND PROPERTY TESSERA_LAYERS ${target})
endfunction()
