# tessera_coordinator: the farm's state behind one lock, over schedule, film and store. No gRPC.
add_library(tessera_coordinator)
add_library(tessera::coordinator ALIAS tessera_coordinator)
target_sources(tessera_coordinator
  PRIVATE client_quota.cpp coordinator.cpp coordinator_commit.cpp coordinator_events.cpp coordinator_frames.cpp
          coordinator_jobs.cpp coordinator_metrics.cpp frame_ledger.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES client_quota.h coordinator.h frame_ledger.h job_view.h)
target_link_libraries(tessera_coordinator
  PUBLIC tessera::events tessera::farm_metrics tessera::schedule tessera::film tessera::store absl::status
         absl::statusor
  PRIVATE nlohmann_json::nlohmann_json absl::strings absl::str_format)
