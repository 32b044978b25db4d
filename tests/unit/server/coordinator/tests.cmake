tessera_test(NAME coordinator KIND unit
  SOURCES unit/server/coordinator/audit_test.cpp unit/server/coordinator/coordinator_test.cpp
          unit/server/coordinator/deliveries_test.cpp
          unit/server/coordinator/error_job_test.cpp unit/server/coordinator/events_test.cpp
          unit/server/coordinator/metrics_test.cpp
          unit/server/coordinator/retention_test.cpp
          unit/server/coordinator/threads_test.cpp
  LINKS tessera::coordinator tessera::observe)
