# A farm of many workers on paper (tests/bench/scale.sh feeds it). Not a test.
add_executable(bench_simulated_farm scaling/simulate.cpp scaling/simulated_farm.cpp)
target_link_libraries(bench_simulated_farm PRIVATE tessera::schedule CLI11::CLI11)
