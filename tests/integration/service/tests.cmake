if(TESSERA_WITH_GRPC)
  tessera_test(NAME service KIND integration
    SOURCES integration/service/farm_test.cpp integration/service/listen_test.cpp
            integration/service/test_worker.cpp
    LINKS tessera::services nlohmann_json::nlohmann_json zstd::libzstd_shared)
  tessera_test(NAME security KIND integration
    SOURCES integration/service/certificates_test.cpp integration/service/client_limits_test.cpp integration/service/joining_test.cpp
            integration/service/roles_test.cpp integration/service/test_worker.cpp
    LINKS tessera::services)
endif()
