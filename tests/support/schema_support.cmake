# Documents against docs/reference/schema: a library for tests, and check_schema for scripts.
add_library(tessera_schema_check STATIC support/json_schema.cpp)
target_link_libraries(tessera_schema_check PUBLIC tessera::flags nlohmann_json::nlohmann_json)
target_compile_definitions(tessera_schema_check PRIVATE TESSERA_SOURCE_DIR="${PROJECT_SOURCE_DIR}")
add_executable(check_schema support/check_schema.cpp)
target_link_libraries(check_schema PRIVATE tessera_schema_check)
