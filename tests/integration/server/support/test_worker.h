#pragma once

#include <grpcpp/grpcpp.h>

#include <deque>
#include <memory>
#include <string>
#include <vector>

#include "contract/film_block.h"
#include "tessera/v1/worker_service.grpc.pb.h"

namespace tessera::server {

/// A worker on real streams, controlled step by step by the test.
class TestWorker {
 public:
  TestWorker(const std::shared_ptr<grpc::Channel>& channel, std::string id);
  ~TestWorker();

  /// Jobs that the server described with leases.
  std::vector<v1::JobDescription> described;
  /// Its hello; change it before open().
  v1::WorkerHello hello;
  /// Token that it sends, and session key that it was given.
  std::string token, session_key;
  /// Sends hello; returns whether the server welcomed it.
  bool open();
  /// Returns the status of Work, which the server has ended.
  grpc::Status finish_work();
  /// Closes both streams; returns the status of Work.
  grpc::Status close();

  struct Unit {
    v1::Lease lease;
    std::int32_t tile = 0;
  };
  /// Reads Work until a unit is leased; returns false when the stream or the job has ended.
  bool next(Unit& unit);
  /// Reads Work until the next acknowledgement; UNSPECIFIED if the stream ends first.
  v1::Acknowledgement next_acknowledgement();
  /// The bytes of the unit's block: a function of the unit alone.
  std::string block_of(const Unit& unit);
  /// Calls DescribeJob.
  grpc::Status describe(const std::string& job_id);
  /// Messages with the block, in chunks of at most `chunk` bytes.
  std::vector<v1::DeliverRequest> messages_of(const Unit& unit, const std::string& block,
                                              std::size_t chunk = 64 << 10);
  /// Sends messages on the Deliver stream; returns false when it has ended.
  bool send(const std::vector<v1::DeliverRequest>& messages);
  grpc::Status finish_deliver();
  /// Renders and delivers until the job has ended or `max_units` units are acknowledged; returns
  /// their number.
  int work(int max_units = 1 << 30);
  void grant(int credits);

 private:
  bool read();
  const v1::RenderSettings& settings_of(const std::string& job_id);

  std::unique_ptr<v1::WorkerService::Stub> stub_;
  grpc::ClientContext work_context_, deliver_context_;
  std::unique_ptr<grpc::ClientReaderWriter<v1::WorkRequest, v1::WorkResponse>> work_;
  v1::DeliverResponse deliver_response_;
  std::unique_ptr<grpc::ClientWriter<v1::DeliverRequest>> deliver_;
  bool has_ended_ = false, is_closed_ = false;
  std::deque<Unit> units_;
  std::deque<v1::Acknowledgement> acknowledgements_;
  std::string job_id_;
  v1::RenderSettings settings_;
};

}  // namespace tessera::server
