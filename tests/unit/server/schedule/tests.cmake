tessera_test(NAME schedule KIND unit
  SOURCES unit/server/schedule/audit_test.cpp unit/server/schedule/job_plan_test.cpp
          unit/server/schedule/job_queue_test.cpp
          unit/server/schedule/lease_test.cpp unit/server/schedule/scene_affinity_test.cpp
          unit/server/schedule/scheduler_test.cpp
  LINKS tessera::schedule)
