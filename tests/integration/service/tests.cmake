if(TESSERA_WITH_GRPC)
  tessera_test(NAME service KIND integration
    SOURCES integration/service/farm_test.cpp integration/service/listen_test.cpp
            integration/service/test_worker.cpp
    LINKS tessera::services nlohmann_json::nlohmann_json zstd::libzstd_shared)
endif()
