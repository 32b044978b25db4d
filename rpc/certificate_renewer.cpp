#include "rpc/certificate_renewer.h"

#include <algorithm>
#include <utility>

#include "rpc/certificates/certificate_files.h"
#include "rpc/channel.h"
#include "rpc/rpc_status.h"
#include "tessera/v1/certificate_service.grpc.pb.h"

namespace tessera::contract {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kCallTimeout{20'000};
/// The files may also be replaced by somebody else.
constexpr milliseconds kLongestWait{3'600'000};
constexpr milliseconds kShortestWait{200};
/// Part of the time left after which a failed attempt is repeated.
constexpr int kAttempts = 20;

milliseconds until(WallTime time) {
  return std::chrono::duration_cast<milliseconds>(time - std::chrono::system_clock::now());
}

}  // namespace

absl::StatusOr<bool> renew_certificate(const std::shared_ptr<grpc::Channel>& channel,
                                       const std::string& folder, grpc::ClientContext& context) {
  const auto lock = CertificateLock::take(folder);
  if (!lock.ok()) return lock.status();
  const auto due = renewal_time(folder);
  if (!due.ok()) return due.status();
  if (until(*due).count() > 0) return true;  // another process has been faster
  const auto key = make_key();
  if (!key.ok()) return key.status();
  prepare_call(context, "", kCallTimeout);
  v1::RenewCertificateRequest request;
  request.set_signing_request(key->signing_request);
  v1::RenewCertificateResponse response;
  absl::Status status = from_rpc(
      v1::CertificateService::NewStub(channel)->RenewCertificate(&context, request, &response));
  if (status.ok()) status = install_certificate(folder, key->key, response.certificate());
  if (!status.ok()) return status;
  return true;
}

CertificateRenewer::CertificateRenewer(Options options)
    : options_(std::move(options)), thread_([this] { run(); }) {}

CertificateRenewer::~CertificateRenewer() {
  {
    const std::lock_guard lock(mutex_);
    is_stopping_ = true;
    if (running_ != nullptr) running_->TryCancel();
  }
  wake_.notify_all();
  thread_.join();
}

void CertificateRenewer::run() {
  milliseconds pause = attempt();
  {
    const std::lock_guard lock(mutex_);
    has_looked_ = true;
  }
  wake_.notify_all();
  while (wait(pause)) pause = attempt();
}

bool CertificateRenewer::await_first_look(milliseconds timeout) {
  std::unique_lock lock(mutex_);
  return wake_.wait_for(lock, timeout, [this] { return has_looked_; });
}

/// Renews the certificate with a call that the destructor cancels. The call is repeated while the
/// client makes too many calls.
absl::Status CertificateRenewer::renew() {
  const auto end = std::chrono::steady_clock::now() + kCallTimeout;
  while (true) {
    grpc::ClientContext context;
    {
      const std::lock_guard lock(mutex_);
      if (is_stopping_) return absl::CancelledError("the program ends");
      running_ = &context;
    }
    const auto renewed = renew_certificate(options_.channel(), options_.folder, context);
    {
      const std::lock_guard lock(mutex_);
      running_ = nullptr;
    }
    if (!is_refused_for_now(context) || std::chrono::steady_clock::now() > end) {
      return renewed.status();
    }
    wait(kShortestWait);
  }
}

/// Renews the certificate if it is due. Returns the time until the next attempt.
milliseconds CertificateRenewer::attempt() {
  const auto due = renewal_time(options_.folder);
  if (due.ok() && until(*due).count() > 0) {
    return std::clamp(until(*due), kShortestWait, kLongestWait);
  }
  const absl::Status status = due.ok() ? renew() : due.status();
  if (status.ok()) {
    options_.renewed();
    return kShortestWait;
  }
  if (absl::IsCancelled(status)) return kShortestWait;  // the destructor waits for the thread
  options_.failed(status);
  const auto end = certificate_end(options_.folder + "/tls.crt");
  const milliseconds left = end.ok() ? until(*end) : kLongestWait;
  return std::clamp(left / kAttempts, kShortestWait, kLongestWait);
}

/// Returns whether to go on.
bool CertificateRenewer::wait(milliseconds pause) {
  std::unique_lock lock(mutex_);
  return !wake_.wait_for(lock, pause, [this] { return is_stopping_; });
}

}  // namespace tessera::contract
