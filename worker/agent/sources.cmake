# tessera_agent: leases, assets, the renderer process; the only worker code that includes grpcpp.
add_library(tessera_agent)
add_library(tessera::agent ALIAS tessera_agent)
target_sources(tessera_agent
  PRIVATE agent/agent.cpp agent/agent_metrics.cpp agent/asset_cache.cpp
          agent/descriptor_reader.cpp agent/job_files.cpp agent/job_log.cpp
          agent/loaded_frames.cpp agent/message_socket.cpp agent/render_desk.cpp
          agent/render_pool.cpp agent/renderer.cpp agent/renderer_process.cpp agent/sandbox.cpp agent/server_link.cpp
          agent/termination.cpp agent/unit_log.cpp agent/unit_queue.cpp agent/worker_streams.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES agent/agent.h agent/agent_metrics.h agent/asset_cache.h agent/descriptor.h
          agent/descriptor_reader.h
          agent/job_files.h agent/job_log.h agent/loaded_frames.h agent/mailbox.h agent/message_socket.h
          agent/render_desk.h agent/render_pool.h agent/renderer.h agent/renderer_process.h
          agent/sandbox.h agent/server_link.h agent/termination.h agent/unit_log.h agent/unit_queue.h
          agent/worker_streams.h)
target_link_libraries(tessera_agent PUBLIC tessera::flags tessera::render tessera::channel tessera::log
  prometheus-cpp::core PRIVATE tessera::metrics Threads::Threads)

add_executable(tessera-worker main.cpp config.cpp config.h)
target_compile_definitions(tessera-worker PRIVATE TESSERA_VERSION="${PROJECT_VERSION}")
target_link_libraries(tessera-worker PRIVATE tessera::agent tessera::image CLI11::CLI11 OpenSSL::Crypto
  draco::draco zstd::libzstd_shared TBB::tbb)
