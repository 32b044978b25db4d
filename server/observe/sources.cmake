# tessera_farm_metrics: what is counted for Prometheus, by name.
add_library(tessera_farm_metrics)
add_library(tessera::farm_metrics ALIAS tessera_farm_metrics)
target_sources(tessera_farm_metrics
  PRIVATE observe/farm_metrics.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES observe/farm_metrics.h)
target_link_libraries(tessera_farm_metrics PUBLIC tessera::schedule prometheus-cpp::core
  PRIVATE absl::strings)

# tessera_observe: what people read of a job. No gRPC.
add_library(tessera_observe)
add_library(tessera::observe ALIAS tessera_observe)
target_sources(tessera_observe
  PRIVATE observe/report.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR} FILES observe/report.h)
target_compile_definitions(tessera_observe PRIVATE TESSERA_VERSION="${PROJECT_VERSION}")
target_link_libraries(tessera_observe PUBLIC tessera::film tessera::schedule tessera::store
  PRIVATE nlohmann_json::nlohmann_json)

# tessera_events: what happened lately, for people who ask.
add_library(tessera_events)
add_library(tessera::events ALIAS tessera_events)
target_sources(tessera_events
  PRIVATE observe/delivery_log.cpp observe/event_log.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES observe/delivery_log.h observe/event_log.h)
target_link_libraries(tessera_events PUBLIC tessera::flags)
