// ServiceFuzzer: calls of any method with random messages.
#include <google/protobuf/message.h>
#include <grpcpp/generic/generic_stub.h>

#include <chrono>

#include "absl/strings/str_cat.h"
#include "server/service/access/access.h"
#include "tessera/v1/certificate_service.grpc.pb.h"
#include "tessera/v1/farm_service.grpc.pb.h"
#include "tests/integration/server/fuzz/random_messages.h"
#include "tests/integration/server/fuzz/service_fuzzer.h"
#include "tests/integration/server/support/all_methods.h"

namespace tessera::server {
namespace {

using google::protobuf::MethodDescriptor;
using grpc::StatusCode;
using std::chrono::milliseconds;

/// For a raw call of a stream that may not end by itself.
constexpr milliseconds kStreamTime{60};

std::string rpc_name(const MethodDescriptor& method) {
  return method.service()->name() + "." + method.name();
}

bool may_call(const Person& person, const AccessRule& rule) {
  return person.is_admin || (person.is_client ? rule.client : rule.worker);
}

/// Returns an empty request.
std::unique_ptr<google::protobuf::Message> new_message(const MethodDescriptor& method) {
  auto* const factory = google::protobuf::MessageFactory::generated_factory();
  return std::unique_ptr<google::protobuf::Message>(
      factory->GetPrototype(method.input_type())->New());
}

}  // namespace

std::vector<std::string> ServiceFuzzer::raw_messages(const MethodDescriptor& method,
                                                     const Person& person) {
  std::vector<std::string> words = {
      "last", "ann",  "bob",     "w1",         "root",
      "id-0", "id-1", "default", "scene.gltf", secret_of(person.name)};
  for (const auto& [id, owner] : owners_) words.push_back(id);
  std::vector<std::string> messages;
  const int count = method.client_streaming() ? 1 + dice_.below(3) : 1;
  for (int i = 0; i < count; ++i) {
    if (dice_.one_in(10)) {
      messages.push_back(random_bytes(dice_));
      continue;
    }
    const auto message = new_message(method);
    if (method.name() == "CreateJob") {
      message->CopyFrom(request_of(absl::StrCat(secret_of(person.name), "-", ++last_number_)));
    }
    scramble(*message, words, dice_);
    if (method.name() == "CreateJob" && dice_.one_in(2)) {  // only a few faults
      message->CopyFrom(request_of(absl::StrCat(secret_of(person.name), "-", last_number_)));
      v1::CreateJobRequest noise;
      scramble(noise, words, dice_, 3);
      message->MergeFrom(noise);
    }
    messages.push_back(message->SerializePartialAsString());
  }
  return messages;
}

ServiceFuzzer::RawAnswer ServiceFuzzer::raw_call(const Person& person,
                                                 const MethodDescriptor& method,
                                                 const std::vector<std::string>& messages) {
  grpc::GenericStub raw(open(person));
  grpc::CompletionQueue queue;
  grpc::ClientContext context;
  const bool is_stream = method.client_streaming() || method.server_streaming();
  // A stream that is refused ends by itself.
  const bool may_last = is_stream && may_call(person, *find_access_rule(rpc_name(method)));
  contract::prepare_call(context, "", may_last ? kStreamTime : milliseconds(20'000));
  const std::string path = "/" + method.service()->full_name() + "/" + method.name();
  const auto call = raw.PrepareCall(&context, path, &queue);
  const auto wait = [&queue] {
    void* tag = nullptr;
    bool ok = false;
    return queue.Next(&tag, &ok) && ok;
  };
  call->StartCall(nullptr);
  bool is_open = wait();
  for (std::size_t i = 0; i < messages.size() && is_open; ++i) {
    const grpc::Slice slice(messages[i]);
    const grpc::ByteBuffer bytes(&slice, 1);
    if (i + 1 < messages.size()) {
      call->Write(bytes, nullptr);
    } else {
      call->WriteLast(bytes, {}, nullptr);
    }
    is_open = wait();
  }
  RawAnswer answer;
  answer.is_malformed = !new_message(method)->ParseFromString(messages.front());
  while (true) {
    grpc::ByteBuffer part;
    call->Read(&part, nullptr);
    if (!wait()) break;
    std::vector<grpc::Slice> slices;
    if (!part.Dump(&slices).ok()) continue;
    for (const grpc::Slice& slice : slices) {
      answer.bytes.append(reinterpret_cast<const char*>(slice.begin()), slice.size());
    }
  }
  call->Finish(&answer.status, nullptr);
  wait();
  return answer;
}

std::string ServiceFuzzer::check_raw(const Person& person, const MethodDescriptor& method,
                                     const RawAnswer& answer) {
  const std::string rpc = rpc_name(method);
  const AccessRule* rule = find_access_rule(rpc);
  const StatusCode code = answer.status.error_code();
  if (rule == nullptr) return rpc + " has no rule";
  if (!may_call(person, *rule)) {
    // gRPC reads the request of a unary call before Tessera's code runs.
    const bool is_unread = code == StatusCode::UNIMPLEMENTED && answer.is_malformed;
    if (code != StatusCode::PERMISSION_DENIED && !is_unread) {
      return absl::StrCat(rpc, " by ", person.name, " gave ", code);
    }
    if (!answer.bytes.empty()) return absl::StrCat(rpc, " answered ", person.name);
  } else if (code == StatusCode::OK) {
    ++counts_.raw_accepted;
  }
  std::string wrong = leak(person, answer.bytes);
  if (wrong.empty()) wrong = leak(person, answer.status.error_message());
  return wrong.empty() ? wrong : absl::StrCat(rpc, ": ", wrong);
}

std::string ServiceFuzzer::call_raw() {
  ++counts_.raw;
  const Person& person = anybody();
  const auto& methods = all_methods();
  const MethodDescriptor& method =
      *methods[static_cast<std::size_t>(dice_.below(static_cast<int>(methods.size())))];
  const RawAnswer answer = raw_call(person, method, raw_messages(method, person));
  std::string wrong = check_raw(person, method, answer);
  if (!wrong.empty()) return wrong;
  // The call may have changed the caller's jobs in any way, but no others.
  const std::vector<v1::Job> jobs = all_jobs();
  for (const v1::Job& job : jobs) owners_.try_emplace(job.id(), job.owner());
  const bool is_worker = !person.is_client && !person.is_admin;
  wrong = is_worker ? model_.difference(jobs)
                    : model_.take_over(jobs, person.is_admin ? "" : person.name);
  return wrong.empty() ? wrong : absl::StrCat(rpc_name(method), " by ", person.name, ": ", wrong);
}

}  // namespace tessera::server
