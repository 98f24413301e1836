//! The parsed file as a tree that remembers where in the text each value stands.

use std::fmt;

use serde::de::{self, Deserialize, Deserializer, MapAccess, SeqAccess, Visitor};
use serde::ser::{Serialize, SerializeMap, SerializeSeq, Serializer};
use serde_saphyr::Spanned;

/// Bytes of the text that a key or value takes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Span {
    pub offset: usize,
    pub len: usize,
}

impl From<serde_saphyr::Location> for Span {
    fn from(location: serde_saphyr::Location) -> Self {
        let span = location.span();
        let offset = span.byte_offset().unwrap_or_else(|| span.offset());
        let len = span.byte_len().unwrap_or_else(|| span.len());
        // A file longer than usize cannot be in memory.
        Self { offset: offset as usize, len: len as usize }
    }
}

/// One value and its place. Values that were not read from a text have an empty span.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub value: Value,
    pub span: Span,
}

#[derive(Debug, Clone)]
pub(crate) enum Value {
    Null,
    Bool(bool),
    Int(i64),
    UInt(u64),
    Float(f64),
    Text(String),
    List(Vec<Node>),
    Map(Vec<Entry>),
}

/// One key of a map, in the order of the file.
#[derive(Debug, Clone)]
pub(crate) struct Entry {
    pub key: String,
    pub key_span: Span,
    pub node: Node,
}

impl Node {
    pub fn bare(value: Value) -> Self {
        Self { value, span: Span::default() }
    }

    fn child(&self, part: &str) -> Option<(&Node, Span)> {
        match &self.value {
            Value::Map(entries) => {
                entries.iter().find(|entry| entry.key == part).map(|entry| (&entry.node, entry.key_span))
            }
            Value::List(items) => {
                part.parse::<usize>().ok().and_then(|index| items.get(index)).map(|item| (item, item.span))
            }
            _ => None,
        }
    }

    /// The value at a dotted key.
    pub fn get(&self, key: &str) -> Option<&Node> {
        key.split('.').try_fold(self, |node, part| node.child(part).map(|(child, _)| child))
    }

    /// Where to point for a dotted key: the value itself when it is a scalar, else its key; the nearest parent
    /// when the key is not in the file.
    pub fn place(&self, key: &str) -> Option<Span> {
        let mut place = None;
        let mut node = self;
        for part in key.split('.').filter(|part| !part.is_empty()) {
            let Some((child, key_span)) = node.child(part) else { break };
            place = Some(if child.is_scalar() && child.span.len > 0 { child.span } else { key_span });
            node = child;
        }
        place
    }

    /// The dotted key of the value or key that stands at a byte of the text.
    pub fn key_at(&self, offset: usize) -> Option<String> {
        let mut found = None;
        self.walk(String::new(), &mut |key, node, key_span| {
            let hit = |span: Span| (span.offset..span.offset + span.len.max(1)).contains(&offset);
            if hit(node.span) || key_span.is_some_and(hit) {
                found = Some(key.to_owned());
            }
        });
        found.filter(|key| !key.is_empty())
    }

    /// Visits every node, parents first: its dotted key, itself, and the span of its key.
    pub fn walk(&self, key: String, visit: &mut impl FnMut(&str, &Node, Option<Span>)) {
        self.walk_from(key, None, visit);
    }

    fn walk_from(&self, key: String, span: Option<Span>, visit: &mut impl FnMut(&str, &Node, Option<Span>)) {
        visit(&key, self, span);
        let join = |part: &str| if key.is_empty() { part.to_owned() } else { format!("{key}.{part}") };
        match &self.value {
            Value::Map(entries) => {
                for entry in entries {
                    entry.node.walk_from(join(&entry.key), Some(entry.key_span), visit);
                }
            }
            Value::List(items) => {
                for (index, item) in items.iter().enumerate() {
                    item.walk_from(join(&index.to_string()), None, visit);
                }
            }
            _ => {}
        }
    }

    /// Puts a value at a dotted key. Blocks that the file leaves to their defaults are made on the way; lists
    /// never grow. Says what is in the way otherwise.
    pub fn set(&mut self, key: &str, node: Node) -> Result<(), String> {
        let (part, rest) = key.split_once('.').map_or((key, None), |(part, rest)| (part, Some(rest)));
        if part.is_empty() {
            return Err("a part of the key is empty".to_owned());
        }
        if matches!(self.value, Value::Null) {
            self.value = Value::Map(Vec::new());
        }
        let child = match &mut self.value {
            Value::Map(entries) => {
                let index = entries.iter().position(|entry| entry.key == part).unwrap_or_else(|| {
                    let node = Node::bare(Value::Null);
                    entries.push(Entry { key: part.to_owned(), key_span: Span::default(), node });
                    entries.len() - 1
                });
                &mut entries[index].node
            }
            Value::List(items) => {
                let count = items.len();
                part.parse::<usize>().ok().and_then(|index| items.get_mut(index)).ok_or_else(|| {
                    format!("`{part}` must be an index below {count}, the length of the list")
                })?
            }
            scalar => return Err(format!("`{part}` looks for a key inside the value {scalar}")),
        };
        match rest {
            Some(rest) => child.set(rest, node),
            None => {
                *child = node;
                Ok(())
            }
        }
    }

    /// Appends to the list at a key of the map at the top, which is made if there is none.
    pub fn push(&mut self, key: &str, node: Node) -> Result<(), String> {
        if self.get(key).is_none_or(|list| matches!(list.value, Value::Null)) {
            self.set(key, Node::bare(Value::List(Vec::new())))?;
        }
        let Value::Map(entries) = &mut self.value else { return Err("the file is no block of keys".into()) };
        match entries.iter_mut().find(|entry| entry.key == key).map(|entry| &mut entry.node.value) {
            Some(Value::List(items)) => {
                items.push(node);
                Ok(())
            }
            _ => Err(format!("`{key}` is no list")),
        }
    }

    /// Takes a key out of the map at the top.
    pub fn remove(&mut self, key: &str) {
        if let Value::Map(entries) = &mut self.value {
            entries.retain(|entry| entry.key != key);
        }
    }

    fn is_scalar(&self) -> bool {
        !matches!(self.value, Value::List(_) | Value::Map(_))
    }

    /// The value as a message shows it; `None` for blocks.
    pub fn shown(&self) -> Option<String> {
        match &self.value {
            Value::Map(_) => None,
            Value::List(items) if items.len() > 8 => None,
            Value::List(items) => {
                let parts: Option<Vec<_>> = items.iter().map(Node::shown).collect();
                parts.map(|parts| format!("[{}]", parts.join(", ")))
            }
            scalar => Some(scalar.to_string()),
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Null => f.write_str("null"),
            Self::Bool(value) => write!(f, "{value}"),
            Self::Int(value) => write!(f, "{value}"),
            Self::UInt(value) => write!(f, "{value}"),
            Self::Float(value) => write!(f, "{value}"),
            Self::Text(value) => write!(f, "{value:?}"),
            Self::List(_) => f.write_str("a list"),
            Self::Map(_) => f.write_str("a block"),
        }
    }
}

impl<'de> Deserialize<'de> for Node {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let spanned = Spanned::<Value>::deserialize(deserializer)?;
        Ok(Self { value: spanned.value, span: spanned.referenced.into() })
    }
}

impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ValueVisitor)
    }
}

struct ValueVisitor;

impl<'de> Visitor<'de> for ValueVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a value")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_none<E>(self) -> Result<Value, E> {
        Ok(Value::Null)
    }

    fn visit_some<D: Deserializer<'de>>(self, deserializer: D) -> Result<Value, D::Error> {
        Value::deserialize(deserializer)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Bool(value))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(Value::Int(value))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(Value::UInt(value))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(Value::Float(value))
    }

    fn visit_str<E: de::Error>(self, value: &str) -> Result<Value, E> {
        Ok(Value::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut access: A) -> Result<Value, A::Error> {
        let mut items = Vec::new();
        while let Some(item) = access.next_element()? {
            items.push(item);
        }
        Ok(Value::List(items))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Value, A::Error> {
        let mut entries = Vec::new();
        while let Some((key, node)) = access.next_entry::<Spanned<String>, Node>()? {
            entries.push(Entry { key: key.value, key_span: key.referenced.into(), node });
        }
        Ok(Value::Map(entries))
    }
}

impl Serialize for Node {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match &self.value {
            Value::Null => serializer.serialize_unit(),
            Value::Bool(value) => serializer.serialize_bool(*value),
            Value::Int(value) => serializer.serialize_i64(*value),
            Value::UInt(value) => serializer.serialize_u64(*value),
            Value::Float(value) => serializer.serialize_f64(*value),
            Value::Text(value) => serializer.serialize_str(value),
            Value::List(items) => {
                let mut list = serializer.serialize_seq(Some(items.len()))?;
                for item in items {
                    list.serialize_element(item)?;
                }
                list.end()
            }
            Value::Map(entries) => {
                let mut map = serializer.serialize_map(Some(entries.len()))?;
                for entry in entries {
                    map.serialize_entry(&entry.key, &entry.node)?;
                }
                map.end()
            }
        }
    }
}
