# tessera_store: what a coordinator must not forget, in one folder. Knows no gRPC.
add_library(tessera_store)
add_library(tessera::store ALIAS tessera_store)
target_sources(tessera_store
  PRIVATE store/asset_files.cpp store/backup.cpp store/check.cpp store/database.cpp store/disk_store.cpp store/disk_store_workers.cpp store/durable_files.cpp
          store/filesystem.cpp store/journal.cpp store/schema.cpp store/segments.cpp
          store/store_open.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES store/asset_files.h store/backup.h store/check.h store/database.h store/disk_store.h store/durable_files.h
          store/filesystem.h store/journal.h store/names.h store/schema.h store/segments.h store/store.h)
target_link_libraries(tessera_store PUBLIC tessera::contract absl::status absl::statusor absl::strings
  PRIVATE SQLite::SQLite3 Threads::Threads)
