#pragma once

#include <grpcpp/grpcpp.h>

#include <map>
#include <memory>
#include <string>
#include <vector>

#include "tests/integration/server/fuzz/job_model.h"
#include "tests/integration/server/support/secure_farm.h"
#include "tests/support/dice.h"

namespace tessera::server {

/// Two clients, two workers and an admin call a server at random, in one thread. Each answer is
/// compared with the model of jobs; no answer may contain what another client named.
class ServiceFuzzer final : public SecureFarm {
 public:
  /// Numbers of calls by kind and result, which show whether a run covers them.
  struct Counts {
    int jobs = 0, orders = 0, refused = 0, looks = 0, raw = 0, raw_accepted = 0, restarts = 0,
        workers = 0;
  };

  explicit ServiceFuzzer(std::uint64_t seed) : dice_(seed) {}
  /// Runs; returns what is wrong, or an empty text.
  std::string run(int steps);
  const Counts& counts() const { return counts_; }

 private:
  using SecureFarm::channel;

  void TestBody() override {}
  std::string step();
  // Steps that the model predicts.
  std::string submit();
  std::string order();
  std::string look();
  std::string look_at_list();
  std::string look_at_events();
  std::string look_at_frame();
  std::string look_at_usage();
  std::string look_at_asset();
  std::string join_worker();
  std::string restart_server();
  // A call of any method with random messages.
  std::string call_raw();
  std::vector<std::string> raw_messages(const google::protobuf::MethodDescriptor& method,
                                        const Person& person);
  struct RawAnswer {
    grpc::Status status;
    std::string bytes;          // of all messages
    bool is_malformed = false;  // the request is no message of its type
  };
  RawAnswer raw_call(const Person& person, const google::protobuf::MethodDescriptor& method,
                     const std::vector<std::string>& messages);
  std::string check_raw(const Person& person, const google::protobuf::MethodDescriptor& method,
                        const RawAnswer& answer);

  grpc::Status give(const Person& person, Order order, const std::string& id, int value);
  std::string compare(const char* what, const Person& person, grpc::StatusCode expected,
                      const grpc::Status& status);
  std::string leak(const Person& person, const std::string& bytes) const;
  std::vector<v1::Job> all_jobs();

  const Person& anybody();
  const Person& any_client() { return people()[static_cast<std::size_t>(dice_.below(2))]; }
  std::string any_job();
  std::string secret_of(const std::string& owner) const { return "secret-of-" + owner; }
  static const std::vector<Person>& people();
  std::shared_ptr<grpc::Channel> open(const Person& person);
  template <typename Service>
  std::unique_ptr<typename Service::Stub> stub(const Person& person) {
    return Service::NewStub(open(person));
  }

  testing::Dice dice_;
  JobModel model_;
  Counts counts_;
  std::map<std::string, std::shared_ptr<grpc::Channel>> channels_;
  std::map<std::string, std::string> owners_;  // of all jobs ever seen
  std::vector<std::unique_ptr<TestWorker>> workers_;
  int last_number_ = 0;
};

}  // namespace tessera::server
