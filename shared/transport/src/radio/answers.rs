//! Replies to queries: the newest message of a publication, and all schemas.
//!
//! zenoh replies with the priority and congestion control of the query, and a blocking reply may wait for
//! seconds (its own priority has no effect in zenoh 1.10). Replies are sent by a separate thread, so that a
//! query blocks neither the middleware's reader nor the process.

use std::sync::mpsc::{Receiver, sync_channel};

use zenoh::{
    Wait,
    bytes::{Encoding, ZBytes},
    key_expr::KeyExpr,
    query::{Query, Queryable},
};

use crate::{
    access::SCHEMA,
    clock::steady_ns,
    radio::{held::PerSecond, publication::Publication},
};
use alight_shared::topics::Topic;

/// Maximum number of pending queries; surplus ones get no reply.
const MAX_WAITING: usize = 16;
/// Maximum rate of replies with one schema, 1/s: schemas are long, and programs query them once.
const MAX_SCHEMAS_PER_S: u32 = 1;

#[derive(Clone, Copy)]
enum Question {
    /// Newest message of this publication.
    Newest(usize),
    Schemas,
}

/// Queryables for these publications, whose keys begin with `name`.
pub(super) fn declare(
    session: &zenoh::Session,
    name: &str,
    publications: &[Publication],
) -> zenoh::Result<Vec<Queryable<()>>> {
    let (sender, questions) = sync_channel(MAX_WAITING);
    let mut answers = Answers::of(name, publications);
    // The thread ends with the queryables, which hold its senders.
    std::thread::Builder::new()
        .name("answers".into())
        .spawn(move || answers.answer_all(&questions))?;
    let held = publications.iter().enumerate().filter(|(_, p)| p.held.is_some());
    let held = held.map(|(number, p)| (p.key.clone(), Question::Newest(number)));
    let schemas = (format!("{name}/{SCHEMA}/**"), Question::Schemas);
    let declared = held.chain([schemas]).map(|(key, question)| {
        let sender = sender.clone();
        let queryable = session.declare_queryable(key).callback(move |query| {
            let _full = sender.try_send((query, question));
        });
        queryable.wait()
    });
    declared.collect()
}

struct Answers {
    publications: Vec<Publication>,
    schemas: Vec<Described>,
}

struct Described {
    key: String,
    topic: &'static Topic,
    text: Option<ZBytes>,
    answers: PerSecond,
}

impl Described {
    /// Schema text for a query on `keys` at `now_ns`, within the rate limit.
    fn asked(&mut self, keys: &KeyExpr<'_>, now_ns: i64) -> Option<ZBytes> {
        let is_asked = KeyExpr::try_from(self.key.as_str()).is_ok_and(|key| keys.intersects(&key));
        if !is_asked || !self.answers.admits(now_ns, MAX_SCHEMAS_PER_S) {
            return None;
        }
        let text = || self.topic.described().to_string().into();
        Some(self.text.get_or_insert_with(text).clone())
    }
}

impl Answers {
    fn of(name: &str, publications: &[Publication]) -> Answers {
        let schema = |p: &Publication| {
            let under = p.key.strip_prefix(name)?.strip_prefix('/')?;
            Some(Described {
                key: format!("{name}/{SCHEMA}/{under}"),
                topic: p.topic?,
                text: None,
                answers: PerSecond::default(),
            })
        };
        Answers {
            publications: publications.to_vec(),
            schemas: publications.iter().filter_map(schema).collect(),
        }
    }
    fn answer_all(&mut self, questions: &Receiver<(Query, Question)>) {
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
    fn described(&mut self, query: &Query) {
        for schema in &mut self.schemas {
            if let Some(text) = schema.asked(query.key_expr(), steady_ns()) {
                reply(query, &schema.key, text, Encoding::APPLICATION_JSON);
            }
        }
    }
}

fn reply(query: &Query, key: &str, bytes: ZBytes, encoding: Encoding) {
    let _gone = query.reply(key, bytes).encoding(encoding).express(true).wait();
}

#[cfg(test)]
mod tests {
    use super::*;
    use alight_shared::{radio::Urgency, topics};

    #[test]
    fn schemas_for_many_who_ask() {
        let publication = |topic: &'static Topic| {
            Publication::new(format!("alight/vessel-1/{}", topic.name), Urgency::Model).of(topic)
        };
        let publications = [publication(&topics::WAVE), publication(&topics::DECK)];
        let mut answers = Answers::of("alight/vessel-1", &publications);
        let mut asked = |keys: &str, now_ns| -> Vec<ZBytes> {
            let keys = KeyExpr::try_from(keys.to_owned()).unwrap();
            let all = answers.schemas.iter_mut();
            all.filter_map(|s| s.asked(&keys, now_ns)).collect()
        };
        let all = "alight/*/@schema/**";
        let second = (0..1000).map(|ms| 1_000_000_000 + ms * 1_000_000);
        let texts: Vec<ZBytes> = second.flat_map(|now_ns| asked(all, now_ns)).collect();
        assert_eq!(texts.len(), 2, "one reply per schema and second");
        assert_eq!(
            &*texts[0].to_bytes(),
            topics::WAVE.described().to_string().as_bytes()
        );
        assert_eq!(asked("alight/vessel-1/@schema/deck", 2_000_000_000).len(), 1);
        assert_eq!(asked(all, 2_500_000_000), texts[..1]);
        assert!(asked("alight/vessel-2/@schema/**", 3_000_000_000).is_empty());
    }

    #[test]
    fn schema_of_every_topic_that_is_sent() {
        let on_the_radio = topics::ALL.iter().filter(|t| t.medium == topics::Medium::Radio);
        let sent: Vec<&'static Topic> = on_the_radio.chain([&topics::VESSEL_PROCESS]).collect();
        let publication = |t: &&'static Topic| {
            Publication::new(format!("alight/vessel-1/{}", t.name), Urgency::Model).of(t)
        };
        let publications: Vec<Publication> = sent.iter().map(publication).collect();
        let mut answers = Answers::of("alight/vessel-1", &publications);
        let all = KeyExpr::try_from("alight/vessel-1/@schema/**").unwrap();
        for (schema, topic) in answers.schemas.iter_mut().zip(&sent) {
            assert_eq!(schema.key, format!("alight/vessel-1/@schema/{}", topic.name));
            let text = schema.asked(&all, 1_000_000_000).unwrap();
            assert_eq!(&*text.to_bytes(), topic.described().to_string().as_bytes());
        }
        assert_eq!(answers.schemas.len(), sent.len());
    }
}
