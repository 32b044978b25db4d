# Simulated workers and the job they work on (run.sh puts the bench together). Not a test.
add_library(tessera_simulated_film STATIC coordinator/simulated_block.cpp)
target_link_libraries(tessera_simulated_film PUBLIC tessera::contract)

add_executable(bench_simulated_workers coordinator/simulate.cpp
  coordinator/simulated_worker.cpp)
target_link_libraries(bench_simulated_workers PRIVATE tessera_simulated_film tessera::channel CLI11::CLI11)

add_executable(bench_coordinator_job coordinator/submit.cpp)
target_link_libraries(bench_coordinator_job PRIVATE tessera_simulated_film tessera::channel
  CLI11::CLI11 nlohmann_json::nlohmann_json)
