#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <utility>

#include "server/coordinator/coordinator.h"
#include "server/service/messages/job_messages.h"
#include "server/store/files/filesystem.h"
#include "server/store/store.h"

namespace tessera::server {

/// A coordinator with its threads over a store on disk, which survives it.
class RunningCoordinator {
 public:
  explicit RunningCoordinator(const std::string& folder, Log log = {}, ClientQuotas quotas = {})
      : store_(Store::open(folder, real_filesystem()).value()),
        coordinator_(
            Coordinator::open(*store_, options(std::move(log), std::move(quotas))).value()) {
    writer_ = std::thread([this] {
      while (!coordinator_->is_stopping()) coordinator_->run_writer(true);
    });
    answers_ = std::thread([this] {
      while (!coordinator_->is_stopping()) coordinator_->run_answers(true);
    });
    for (std::thread& thread : film_) {
      thread = std::thread([this] {
        while (!coordinator_->is_stopping()) coordinator_->run_film(true);
      });
    }
    timer_ = std::thread([this] {
      while (!coordinator_->is_stopping()) {
        coordinator_->tick();
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
      }
    });
  }
  ~RunningCoordinator() {
    coordinator_->stop();
    for (std::thread* thread : {&writer_, &answers_, &film_[0], &film_[1], &timer_}) thread->join();
  }

  Coordinator& coordinator() { return *coordinator_; }

 private:
  static constexpr int kFilmThreads = 2;

  static FarmOptions options(Log log, ClientQuotas quotas) {
    FarmOptions options;
    options.film_threads = kFilmThreads;
    options.client_quotas = std::move(quotas);
    options.policy.restart_grace = std::chrono::milliseconds(50);
    options.policy.client_priority = 50;
    options.clock = [] { return std::chrono::steady_clock::now(); };
    options.wall_us = [] { return std::int64_t{1'700'000'000'000'000}; };
    options.random = [state = std::uint64_t{7}]() mutable {
      return state = state * 6364136223846793005u + 1442695040888963407u;
    };
    options.read_spec = read_spec;
    options.write_request = write_request;
    options.log = std::move(log);
    return options;
  }

  std::unique_ptr<Store> store_;
  std::unique_ptr<Coordinator> coordinator_;
  std::thread writer_, answers_, film_[kFilmThreads], timer_;
};

}  // namespace tessera::server
