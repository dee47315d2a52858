//! What every call has to pass before its message is read: the caller's role; and while it is
//! read: a bound on the memory that all messages under way take together, and on the time that one
//! may take to arrive. Answers are counted on their way out (`unread`).

use super::{
    Caller, Role, Tokens,
    budget::{Arriving, Budget},
    prefix::Prefix,
    strangers::Peer,
    unread::{Counted, Unread},
};
use crate::{metrics::Metrics, service::refuse};
use http::{Request, Response, header::AUTHORIZATION};
use http_body::{Frame, SizeHint};
use std::{
    future::Future,
    pin::{Pin, pin},
    sync::Arc,
    task::{Context, Poll},
};
use tokio::time::{Instant, Sleep, sleep};
use tonic::{Code, Status, body::Body, transport::server::TlsConnectInfo};
use tower::{Layer, Service};

/// The calls that a reader may make; everything else of the same service is for operators.
const READERS_CALLS: [&str; 5] = [
    "Status",
    "ListJobs",
    "ListWorkers",
    "WatchEvents",
    "GetBlob",
];

/// The call whose answer goes on for as long as its caller likes, and as slowly: who is slow misses
/// events.
const ENDLESS_CALL: &str = "/brdfarm.v1.Control/WatchEvents";

/// Puts a [`Guarded`] before a service.
#[derive(Clone)]
pub(crate) struct Guard {
    tokens: Option<Arc<Tokens>>,
    budget: Budget,
    unread: Unread,
    metrics: Arc<Metrics>,
}

/// A service whose callers are known and whose messages are bounded.
#[derive(Clone)]
pub(crate) struct Guarded<S> {
    guard: Guard,
    service: S,
}

/// A message on its way in.
struct Metered {
    body: Body,
    prefix: Prefix,
    arriving: Arriving,
    deadline: Pin<Box<Sleep>>,
}

impl Guard {
    pub fn new(tokens: Option<Tokens>, unread: Unread, metrics: Arc<Metrics>) -> Self {
        Self {
            tokens: tokens.map(Arc::new),
            budget: Budget::default(),
            unread,
            metrics,
        }
    }

    /// Who calls; none where nobody has to say, or may know all the same.
    fn admit<B>(&self, request: &Request<B>) -> Result<Option<Caller>, Status> {
        let Some(tokens) = &self.tokens else {
            return Ok(None);
        };
        let path = request.uri().path();
        // Whether it is alive anybody may ask, as those do who start it again.
        if path.starts_with("/grpc.health.v1.Health/") {
            return Ok(None);
        }
        let shown = request.headers().get(AUTHORIZATION);
        let shown = shown.and_then(|value| value.as_bytes().strip_prefix(b"Bearer "));
        let Some(shown) = shown else {
            let what = "this coordinator wants a token: pass --credentials";
            return Err(refuse(Code::Unauthenticated, "NO_TOKEN", what));
        };
        let Some(caller) = tokens.caller(shown) else {
            let what = "this coordinator does not know the token";
            return Err(refuse(Code::Unauthenticated, "UNKNOWN_TOKEN", what));
        };
        if may(caller.role, path) {
            return Ok(Some(caller.clone()));
        }
        let role = caller.role;
        let what = format!("a token of the role {role:?} is not for this call").to_lowercase();
        Err(refuse(Code::PermissionDenied, "WRONG_ROLE", what))
    }
}

/// Who is at the other end of a call's connection; nobody where there is none, as in a test.
fn peer<B>(request: &Request<B>) -> Option<&Peer> {
    let extensions = request.extensions();
    let encrypted = extensions.get::<TlsConnectInfo<Peer>>();
    let plain = || extensions.get::<Peer>();
    encrypted.map(TlsConnectInfo::get_ref).or_else(plain)
}

fn may(role: Role, path: &str) -> bool {
    if path.starts_with("/brdfarm.v1.Farm/") {
        // An operator's rendering decides disputes.
        return matches!(role, Role::Worker | Role::Operator);
    }
    let readers = match path.strip_prefix("/brdfarm.v1.Control/") {
        Some(call) => READERS_CALLS.contains(&call),
        // What the services are is no secret among those who have a token.
        None => return true,
    };
    role == Role::Operator || (role == Role::Reader && readers)
}

impl http_body::Body for Metered {
    type Data = <Body as http_body::Body>::Data;
    type Error = Status;

    fn poll_frame(
        mut self: Pin<&mut Self>,
        context: &mut Context<'_>,
    ) -> Poll<Option<Result<Frame<Self::Data>, Status>>> {
        let polled = pin!(&mut self.body).poll_frame(context);
        let data = match &polled {
            Poll::Ready(Some(Ok(frame))) => frame.data_ref().map_or(&[][..], |data| &data[..]),
            _ => &[],
        };
        let bytes = data.len();
        if let Some(announced) = self.prefix.read(data) {
            self.arriving.announce(announced);
        }
        if self.arriving.poll_put_out(context) || (bytes > 0 && !self.arriving.take(bytes)) {
            let what = "too many messages are under way: try again later";
            let status = refuse(Code::ResourceExhausted, "BUSY", what);
            return Poll::Ready(Some(Err(status)));
        }
        let over = matches!(polled, Poll::Ready(None)) || self.body.is_end_stream();
        if !over && self.deadline.as_mut().poll(context).is_ready() {
            let seconds = limits::MESSAGE_DEADLINE.as_secs();
            let what = format!("the message took more than {seconds} s to arrive");
            let status = refuse(Code::DeadlineExceeded, "SLOW_MESSAGE", what);
            return Poll::Ready(Some(Err(status)));
        }
        polled
    }

    fn is_end_stream(&self) -> bool {
        self.body.is_end_stream()
    }

    fn size_hint(&self) -> SizeHint {
        self.body.size_hint()
    }
}

impl<S> Layer<S> for Guard {
    type Service = Guarded<S>;

    fn layer(&self, service: S) -> Guarded<S> {
        Guarded {
            guard: self.clone(),
            service,
        }
    }
}

type Answer<E> = Pin<Box<dyn Future<Output = Result<Response<Body>, E>> + Send>>;

impl<S> Service<Request<Body>> for Guarded<S>
where
    S: Service<Request<Body>, Response = Response<Body>>,
    S::Future: Send + 'static,
    S::Error: Send,
{
    type Response = Response<Body>;
    type Error = S::Error;
    type Future = Answer<S::Error>;

    fn poll_ready(&mut self, context: &mut Context<'_>) -> Poll<Result<(), S::Error>> {
        self.service.poll_ready(context)
    }

    fn call(&mut self, mut request: Request<Body>) -> Answer<S::Error> {
        let began = Instant::now();
        let path = request.uri().path().to_owned();
        let metrics = Arc::clone(&self.guard.metrics);
        let peer = peer(&request).cloned();
        let credential = match self.guard.admit(&request) {
            Ok(caller) => {
                // Asking after the health takes no token, and makes nobody known.
                if (self.guard.tokens.is_none() || caller.is_some())
                    && let Some(peer) = &peer
                {
                    peer.introduce();
                }
                let credential = caller.as_ref().map(|caller| Arc::clone(&caller.credential));
                if let Some(caller) = caller {
                    request.extensions_mut().insert(caller);
                }
                credential
            }
            Err(status) => {
                metrics.note_call(&path, began.elapsed(), Some(status.code()));
                return Box::pin(async move { Ok(status.into_http()) });
            }
        };
        let (arriving, share) = self.guard.budget.message(credential);
        let request = request.map(|body| {
            Body::new(Metered {
                body,
                prefix: Prefix::default(),
                arriving,
                deadline: Box::pin(sleep(limits::MESSAGE_DEADLINE)),
            })
        });
        let answer = self.service.call(request);
        let unread = self.guard.unread.clone();
        Box::pin(async move {
            let answer = answer.await;
            // What was read stays in memory until the call is done with it.
            drop(share);
            if let Ok(answer) = &answer {
                let refused = Status::from_header_map(answer.headers());
                let refused = refused.map(|status| status.code());
                let refused = refused.filter(|code| *code != Code::Ok);
                metrics.note_call(&path, began.elapsed(), refused);
            }
            let Some(peer) = peer else {
                return answer;
            };
            let wait_max = (path != ENDLESS_CALL).then_some(limits::UNREAD_WAIT_MAX);
            let counted = |body| {
                Body::new(Counted {
                    body,
                    unread,
                    peer,
                    wait_max,
                })
            };
            answer.map(|answer| answer.map(counted))
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use http_body::Body as _;

    #[test]
    fn each_role_has_its_calls() {
        use Role::{Operator, Reader, Worker};
        for (path, allowed) in [
            ("/brdfarm.v1.Farm/Lease", &[Worker, Operator][..]),
            ("/brdfarm.v1.Farm/PutBlob", &[Worker, Operator]),
            ("/brdfarm.v1.Control/Status", &[Operator, Reader]),
            ("/brdfarm.v1.Control/GetBlob", &[Operator, Reader]),
            ("/brdfarm.v1.Control/Pause", &[Operator]),
            ("/brdfarm.v1.Control/Statusx", &[Operator]),
            (
                "/grpc.reflection.v1.ServerReflection/x",
                &[Worker, Operator, Reader],
            ),
        ] {
            for role in [Worker, Operator, Reader] {
                assert_eq!(may(role, path), allowed.contains(&role), "{role:?} {path}");
            }
        }
    }

    /// A message that trickles in is given up, and one beyond the budget is not read.
    #[tokio::test(start_paused = true)]
    async fn slow_and_surplus_messages_are_refused() {
        let budget = Budget::default();
        let metered = |body| Metered {
            body: Body::new(body),
            prefix: Prefix::default(),
            arriving: budget.message(None).0,
            deadline: Box::pin(sleep(limits::MESSAGE_DEADLINE)),
        };
        let mut slow = metered(Trickle {
            frames: 10_000,
            data: vec![0; 16],
        });
        let began = Instant::now();
        let refused = loop {
            let frame = std::future::poll_fn(|context| pin!(&mut slow).poll_frame(context)).await;
            match frame {
                Some(Ok(_)) => sleep(std::time::Duration::from_secs(1)).await,
                Some(Err(status)) => break status,
                None => panic!("it was read to its end"),
            }
        };
        assert_eq!(refused.code(), Code::DeadlineExceeded);
        assert!(began.elapsed() < 2 * limits::MESSAGE_DEADLINE);

        drop(slow);
        let (mut others, _share) = budget.message(Some("others".into()));
        assert!(others.take(limits::LONG_MESSAGES_BYTES_MAX));
        let long = vec![0; limits::SHORT_MESSAGE_BYTES_MAX + 1];
        // One says at once that it will be 6 MiB long.
        let announced = [0, 0, 0x60, 0, 0].to_vec();
        for data in [long, announced] {
            let mut surplus = metered(Trickle { frames: 1, data });
            let frame =
                std::future::poll_fn(|context| pin!(&mut surplus).poll_frame(context)).await;
            let Some(Err(refused)) = frame else {
                panic!("it was read");
            };
            assert_eq!(refused.code(), Code::ResourceExhausted);
        }
    }

    /// A body whose frames are always there, until there are no more and it never ends.
    struct Trickle {
        frames: u32,
        /// Of each.
        data: Vec<u8>,
    }

    impl http_body::Body for Trickle {
        type Data = <Body as http_body::Body>::Data;
        type Error = Status;

        fn poll_frame(
            mut self: Pin<&mut Self>,
            _: &mut Context<'_>,
        ) -> Poll<Option<Result<Frame<Self::Data>, Status>>> {
            match self.frames.checked_sub(1) {
                Some(left) => {
                    self.frames = left;
                    Poll::Ready(Some(Ok(Frame::data(self.data.clone().into()))))
                }
                None => Poll::Pending,
            }
        }
    }
}
