#include "tests/integration/server/support/test_worker.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "contract/digest.h"
#include "contract/tile_grid.h"
#include "contract/version.h"
#include "rpc/channel.h"
#include "rpc/protocol_version.h"
#include "rpc/settings_message.h"

namespace tessera::server {
namespace {

constexpr std::chrono::seconds kPatience{100};

}  // namespace

TestWorker::TestWorker(const std::shared_ptr<grpc::Channel>& channel, std::string id)
    : stub_(v1::WorkerService::NewStub(channel)) {
  hello.set_worker_id(id);
  hello.set_name(std::move(id));
  hello.set_protocol_version(contract::kProtocolVersion);
  hello.set_contract_version(contract::kRenderContract);
  hello.set_numerics_sha256(contract::Digest::from_hex(contract::kNumericsSha256)->binary());
  hello.set_isa("avx2");
  hello.set_thread_count(2);
  hello.set_credit_count(4);
}

TestWorker::~TestWorker() {
  if (work_ && !is_closed_) close();
}

bool TestWorker::open() {
  contract::prepare_call(work_context_, token, kPatience);
  work_ = stub_->Work(&work_context_);
  v1::WorkRequest request;
  *request.mutable_hello() = hello;
  work_->Write(request);
  v1::WorkResponse response;
  const bool is_welcome = work_->Read(&response) && response.has_welcome();
  session_key = response.welcome().session_key();
  return is_welcome;
}

grpc::Status TestWorker::finish_work() {
  is_closed_ = true;
  return work_->Finish();
}

grpc::Status TestWorker::close() {
  is_closed_ = true;
  if (deliver_) finish_deliver();
  work_->WritesDone();
  for (v1::WorkResponse response; work_->Read(&response);) {
  }
  return work_->Finish();
}

bool TestWorker::read() {
  v1::WorkResponse response;
  if (!work_->Read(&response)) return false;
  for (const v1::JobDescription& job : response.leases().jobs()) described.push_back(job);
  for (const v1::Lease& lease : response.leases().leases()) {
    for (int i = 0; i < lease.tile_count(); ++i) units_.push_back({lease, lease.first_tile() + i});
  }
  for (const auto& acknowledgement : response.acknowledgements().acknowledgements()) {
    acknowledgements_.push_back(acknowledgement);
  }
  if (response.has_job_ended()) has_ended_ = true;
  return true;
}

bool TestWorker::next(Unit& unit) {
  while (units_.empty()) {
    if (has_ended_ || !read()) return false;
  }
  unit = units_.front();
  units_.pop_front();
  return true;
}

v1::Acknowledgement TestWorker::next_acknowledgement() {
  while (acknowledgements_.empty()) {
    if (!read()) return {};
  }
  v1::Acknowledgement acknowledgement = acknowledgements_.front();
  acknowledgements_.pop_front();
  return acknowledgement;
}

grpc::Status TestWorker::describe(const std::string& job_id) {
  grpc::ClientContext context;
  contract::prepare_call(context, "", kPatience);
  v1::DescribeJobRequest request;
  request.set_job_id(job_id);
  v1::DescribeJobResponse response;
  grpc::Status status = stub_->DescribeJob(&context, request, &response);
  job_id_ = job_id;
  settings_ = response.settings();
  return status;
}

const v1::RenderSettings& TestWorker::settings_of(const std::string& job_id) {
  if (job_id_ != job_id) describe(job_id);
  return settings_;
}

std::string TestWorker::block_of(const Unit& unit) {
  const contract::TileGrid grid(*contract::from_message(settings_of(unit.lease.job_id())));
  const contract::PixelRect rect = grid.rect(unit.tile);
  contract::FilmBlock block =
      contract::FilmBlock::zeros({rect.width, rect.height, 0, unit.lease.pass() == 0});
  for (std::size_t i = 0; i < block.rgb.size(); ++i) {
    block.rgb[i] = static_cast<float>(i % 7 + static_cast<std::size_t>(unit.tile)) *
                   static_cast<float>(unit.lease.sample_count());
  }
  for (float& alpha : block.alpha) alpha = static_cast<float>(unit.lease.sample_count());
  return contract::encode(block);
}

std::vector<v1::DeliverRequest> TestWorker::messages_of(const Unit& unit, const std::string& block,
                                                        std::size_t chunk) {
  std::vector<v1::DeliverRequest> messages;
  for (std::size_t at = 0; at < block.size(); at += chunk) {
    v1::BlockPart& part = *messages.emplace_back().add_parts();
    part.set_chunk(block.substr(at, chunk));
    if (at > 0) continue;
    v1::BlockHeader& header = *part.mutable_header();
    *header.mutable_lease() = unit.lease;
    header.set_tile(unit.tile);
    header.set_size_bytes(static_cast<std::int64_t>(block.size()));
    header.set_wire_size_bytes(static_cast<std::int64_t>(block.size()));
    header.set_sha256(contract::sha256(block).binary());
    header.set_cpu_seconds(0.25);
    header.set_ray_count(8);
    header.set_visited_node_count(20);
    header.set_tested_primitive_count(4);
  }
  return messages;
}

bool TestWorker::send(const std::vector<v1::DeliverRequest>& messages) {
  bool is_open = true;
  for (v1::DeliverRequest message : messages) {
    if (!deliver_) {
      contract::prepare_call(deliver_context_, "", kPatience);
      deliver_ = stub_->Deliver(&deliver_context_, &deliver_response_);
      message.set_worker_id(hello.worker_id());
    }
    is_open = is_open && deliver_->Write(message);
  }
  return is_open;
}

grpc::Status TestWorker::finish_deliver() {
  deliver_->WritesDone();
  grpc::Status status = deliver_->Finish();
  deliver_.reset();
  return status;
}

void TestWorker::grant(int credits) {
  v1::WorkRequest request;
  request.mutable_credits()->set_unit_count(credits);
  work_->Write(request);
}

int TestWorker::work(int max_units) {
  int done = 0;
  for (Unit unit; done < max_units && next(unit); ++done) {
    send(messages_of(unit, block_of(unit), 5000));
    if (next_acknowledgement().status() == v1::Acknowledgement::ACK_STATUS_UNSPECIFIED) break;
    grant(1);
  }
  return done;
}

}  // namespace tessera::server
