#pragma once

#include <grpcpp/support/status_code_enum.h>

#include <map>
#include <string>
#include <vector>

#include "tessera/v1/job_service.pb.h"

namespace tessera::server {

/// Who calls.
struct Person {
  std::string name;
  bool is_client = false, is_admin = false;  // neither: a worker
};

/// What a client may order about a job.
enum class Order { pause, resume, cancel, retry, remove, extend, raise_priority };
inline constexpr int kOrderCount = 7;
const char* order_name(Order order);

/// The jobs of a farm as they should be: who may see and change which, and how orders change them.
/// Knows nothing of the server's code.
class JobModel {
 public:
  struct Job {
    std::string owner, name;
    v1::Job::State state = v1::Job::STATE_QUEUED;
    int priority = 0, sample_count = 0;
  };

  void add(const std::string& id, Job job) { jobs_[id] = std::move(job); }
  const std::map<std::string, Job>& jobs() const { return jobs_; }
  bool sees(const Person& person, const std::string& id) const;
  /// Returns the IDs that the person sees.
  std::vector<std::string> visible(const Person& person) const;

  /// Carries out an order and returns the status that it should have. `value`: the new priority or
  /// number of samples.
  grpc::StatusCode give(const Person& person, Order order, const std::string& id, int value);

  /// Compares with all jobs of the farm; returns how they differ, or an empty text. A job that can
  /// be rendered may be QUEUED or RUNNING.
  std::string difference(const std::vector<v1::Job>& farm) const;
  /// Takes over the farm's jobs of one owner (empty: of all), which were changed in unknown ways.
  /// Returns what changed of other owners' jobs, or an empty text.
  std::string take_over(const std::vector<v1::Job>& farm, const std::string& owner);

 private:
  grpc::StatusCode apply(const Person& person, Order order, Job& job, int value);

  std::map<std::string, Job> jobs_;
};

}  // namespace tessera::server
