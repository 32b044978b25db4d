# The protos with their comments, for the test of their style.
set(descriptor_set ${CMAKE_CURRENT_BINARY_DIR}/tessera_descriptors.bin)
file(GLOB style_protos CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/proto/tessera/v1/*.proto)
add_custom_command(OUTPUT ${descriptor_set}
  COMMAND protobuf::protoc --include_source_info --include_imports
          --descriptor_set_out=${descriptor_set} -I ${PROJECT_SOURCE_DIR}/proto ${style_protos}
  DEPENDS ${style_protos} VERBATIM)
add_custom_target(proto_descriptors DEPENDS ${descriptor_set})
tessera_test(NAME proto_style KIND unit SOURCES unit/proto/style_test.cpp LINKS protobuf::libprotobuf)
add_dependencies(unit_proto_style_test proto_descriptors)
target_compile_definitions(unit_proto_style_test PRIVATE TESSERA_DESCRIPTOR_SET="${descriptor_set}")
