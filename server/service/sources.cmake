# tessera_services: the coordinator on the wire. The only server code that includes grpcpp.
add_library(tessera_services)
add_library(tessera::services ALIAS tessera_services)
target_sources(tessera_services
  PRIVATE service/access.cpp service/asset_service.cpp service/block_assembly.cpp service/client_limits.cpp
          service/deliver_stream.cpp service/event_stream.cpp service/frame_stream.cpp service/job_service.cpp
          service/messages.cpp service/numerics_check.cpp service/server.cpp service/token.cpp
          service/watch_stream.cpp service/work_stream.cpp service/worker_admission.cpp
          service/worker_service.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES service/access.h service/asset_service.h service/block_assembly.h service/client_limits.h
          service/deliver_stream.h service/event_stream.h service/frame_stream.h service/job_service.h service/messages.h
          service/numerics_check.h service/server.h service/token.h service/watch_stream.h
          service/work_stream.h service/worker_admission.h service/worker_service.h)
target_link_libraries(tessera_services
  PUBLIC tessera::coordinator tessera::identity tessera::channel
  PRIVATE tessera::observe gRPC::grpc++_reflection OpenSSL::Crypto zstd::libzstd_shared absl::strings)

# tessera-server: wires it all up.
add_executable(tessera-server main.cpp config.cpp identity_commands.cpp store_commands.cpp)
target_link_libraries(tessera-server
  PRIVATE tessera::services tessera::identity tessera::image tessera::observe tessera::log
          tessera::metrics absl::time CLI11::CLI11 OpenSSL::Crypto SQLite::SQLite3 zstd::libzstd_shared Threads::Threads)
target_compile_definitions(tessera-server PRIVATE TESSERA_VERSION="${PROJECT_VERSION}")
install(TARGETS tessera-server)
