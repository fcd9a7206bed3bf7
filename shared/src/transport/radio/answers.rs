//! Answers to who asks: the newest message of a publication, and the schemas of all.
//!
//! zenoh sends an answer with the priority and the congestion control of its question, and one that is to be waited for may
//! wait for seconds. So a thread of their own sends the answers, and neither the middleware's reader nor the
//! process stands still for somebody who asks.

use std::sync::mpsc::{Receiver, sync_channel};

use zenoh::Wait;
use zenoh::bytes::{Encoding, ZBytes};
use zenoh::key_expr::KeyExpr;
use zenoh::query::{Query, Queryable};

use crate::topics::Topic;
use crate::transport::access::SCHEMA;
use crate::transport::clock::steady_ns;
use crate::transport::radio::publication::Publication;

/// Questions that wait; what comes on top has no answer.
const MAX_WAITING: usize = 16;

/// What is asked for.
#[derive(Clone, Copy)]
enum Question {
    /// The newest message of this publication.
    Newest(usize),
    /// Schemas.
    Schemas,
}

/// Declares who answers for these publications, whose keys begin with `name`.
pub(super) fn declare(
    session: &zenoh::Session,
    name: &str,
    publications: &[Publication],
) -> zenoh::Result<Vec<Queryable<()>>> {
    let (sender, questions) = sync_channel(MAX_WAITING);
    let answers = Answers::of(name, publications);
    // It ends with the queryables, which hold its senders.
    std::thread::Builder::new()
        .name("answers".into())
        .spawn(move || answers.answer_all(&questions))?;
    let held = publications.iter().enumerate().filter(|(_, p)| p.held.is_some());
    let held = held.map(|(number, p)| (p.key.clone(), Question::Newest(number)));
    let schemas = (format!("{name}/{SCHEMA}/**"), Question::Schemas);
    let declared = held.chain([schemas]).map(|(key, question)| {
        let sender = sender.clone();
        let queryable = session.declare_queryable(key).callback(move |query| {
            // One that finds no room ends without an answer.
            let _full = sender.try_send((query, question));
        });
        queryable.wait()
    });
    declared.collect()
}

/// What there is to answer with.
struct Answers {
    publications: Vec<Publication>,
    /// Topics under the keys of their schemas.
    schemas: Vec<(String, &'static Topic)>,
}

impl Answers {
    fn of(name: &str, publications: &[Publication]) -> Answers {
        let schema = |p: &Publication| {
            let under = p.key.strip_prefix(name)?.strip_prefix('/')?;
            Some((format!("{name}/{SCHEMA}/{under}"), p.topic?))
        };
        Answers {
            publications: publications.to_vec(),
            schemas: publications.iter().filter_map(schema).collect(),
        }
    }
    fn answer_all(&self, questions: &Receiver<(Query, Question)>) {
        while let Ok((query, question)) = questions.recv() {
            match question {
                Question::Newest(number) => self.newest(&query, number),
                Question::Schemas => self.described(&query),
            }
        }
    }
    fn newest(&self, query: &Query, number: usize) {
        let Some(publication) = self.publications.get(number) else {
            return;
        };
        let held = publication.held.as_ref();
        if let Some(bytes) = held.and_then(|h| h.take(steady_ns())) {
            reply(query, &publication.key, bytes, publication.encoding());
        }
    }
    fn described(&self, query: &Query) {
        for (key, topic) in &self.schemas {
            let is_asked = |key: KeyExpr<'_>| query.key_expr().intersects(&key);
            if KeyExpr::try_from(key.as_str()).is_ok_and(is_asked) {
                let text = topic.described().to_string();
                reply(query, key, text.into(), Encoding::APPLICATION_JSON);
            }
        }
    }
}

fn reply(query: &Query, key: &str, bytes: ZBytes, encoding: Encoding) {
    // Who asked may have gone.
    let _gone = query.reply(key, bytes).encoding(encoding).express(true).wait();
}
