# tessera_schedule: who renders what. Pure: no lock, clock, thread, file or network.
add_library(tessera_schedule)
add_library(tessera::schedule ALIAS tessera_schedule)
target_sources(tessera_schedule
  PRIVATE schedule/audit.cpp schedule/job.cpp schedule/job_plan.cpp schedule/job_queue.cpp schedule/lease.cpp
          schedule/scheduler_audits.cpp schedule/scheduler_dispatch.cpp
          schedule/scheduler_jobs.cpp schedule/scheduler_orders.cpp schedule/scheduler_workers.cpp
  PUBLIC FILE_SET HEADERS BASE_DIRS ${PROJECT_SOURCE_DIR}
    FILES mutex.h schedule/audit.h schedule/job.h schedule/job_plan.h schedule/job_queue.h schedule/job_spec.h
          schedule/lease.h schedule/scheduler.h schedule/worker.h)
target_link_libraries(tessera_schedule PUBLIC tessera::flags tessera::contract absl::status)
